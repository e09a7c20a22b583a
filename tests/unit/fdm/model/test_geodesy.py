import pytest

from fdm.model.geodesy import GeodeticPosition, Home, geodetic_from_ned, ned_from_geodetic

HOME = GeodeticPosition(47.0, 8.0, 400.0)


def test_one_ardupilot_degree():
    # 1e7 * LOCATION_SCALING_FACTOR of ArduPilot's Location.h, and cos(47 deg) of it.
    north, east, down = ned_from_geodetic(HOME, GeodeticPosition(48.0, 8.0, 410.0))
    assert (north, east, down) == (pytest.approx(111318.845, abs=1e-3), 0.0, -10.0)
    _, east, _ = ned_from_geodetic(HOME, GeodeticPosition(47.0, 9.0, 400.0))
    assert east == pytest.approx(111318.845 * 0.6819983601, abs=1e-2)


def test_east_over_the_date_line_is_short():
    fiji = GeodeticPosition(-17.0, 179.999, 0.0)
    _, east, _ = ned_from_geodetic(fiji, GeodeticPosition(-17.0, -179.999, 0.0))
    assert east == pytest.approx(0.002 * 111318.845 * 0.95630, rel=1e-4)
    assert geodetic_from_ned(fiji, (0.0, east, 0.0)).lon_deg == pytest.approx(-179.999)


@pytest.mark.parametrize(("lat", "lon", "alt"), [(91, 0, 0), (0, 181, 0), (0, 0, float("nan"))])
def test_a_place_that_is_none_is_refused(lat, lon, alt):
    with pytest.raises(ValueError, match="must be"):
        GeodeticPosition(lat, lon, alt)


def test_a_yaw_that_is_none_is_refused():
    with pytest.raises(ValueError, match="yaw_deg"):
        Home(HOME, float("inf"))
