import math

import numpy as np
import pytest

from fdm.air.turbulence import AIRSPEED_MIN_MPS, intensities_mps, lengths_m
from fdm.air.wind import WindConfig, load_wind, wind_from_mapping, wind_names
from fdm.errors import WindError
from fdm.model.air_point import AirPoint
from fdm.model.geodesy import GeodeticPosition, geodetic_from_ned

ORIGIN = GeodeticPosition(47.0, 8.0, 400.0)


def at(time_s=0.0, ned_m=(0.0, 0.0, -50.0), velocity_ned_mps=(15.0, 0.0, 0.0)):
    place = geodetic_from_ned(ORIGIN, ned_m)
    return AirPoint(
        round(time_s * 1e9), place.lat_deg, place.lon_deg, place.alt_amsl_m, -ned_m[2], velocity_ned_mps
    )


def build(seed=1, ua_id=0, **parts):
    return WindConfig.model_validate(parts).build(seed=seed, ua_id=ua_id)


@pytest.mark.parametrize("name", wind_names())
def test_every_wind_that_ships_blows_finitely(name):
    wind = load_wind(name).build(seed=1, ua_id=0)
    for second in range(100):
        assert all(abs(component) < 40 for component in wind.air_ned_mps(at(second)))


def test_calm_is_calm():
    for wind in (load_wind("calm").build(seed=1, ua_id=0), build(constant={"speed_mps": 0, "from_deg": 0})):
        assert repr(wind.air_ned_mps(at())) == "(0.0, 0.0, 0.0)"  # -0.0 would be other bytes in a record


def test_wind_comes_from_its_direction():
    wind = build(constant={"speed_mps": 8, "from_deg": 270, "up_mps": 1})
    assert wind.air_ned_mps(at()) == pytest.approx((0, 8, -1), abs=1e-12)


@pytest.mark.parametrize(
    ("time_s", "share"),
    [(9.9, 0), (11, 0.5), (12, 1), (14.9, 1), (15.5, 0.5), (16.1, 0), (31, 0.5), (29.9, 0)],
)
def test_a_gust_rises_holds_falls_and_comes_again(time_s, share):
    gust = {
        "speed_mps": 6,
        "from_deg": 180,
        "start_s": 10,
        "rise_s": 2,
        "hold_s": 3,
        "fall_s": 1,
        "every_s": 20,
    }
    assert build(gusts=[gust]).air_ned_mps(at(time_s))[0] == pytest.approx(6 * share, abs=1e-9)


def test_parts_add_up():
    gust = {"speed_mps": 6, "from_deg": 180, "start_s": 0, "rise_s": 1, "hold_s": 9}
    wind = build(constant={"speed_mps": 2, "from_deg": 180}, gusts=[gust, gust])
    assert wind.air_ned_mps(at(5.0)) == pytest.approx((14, 0, 0), abs=1e-9)


def test_dryden_scales_are_those_of_the_standard():
    # MIL-F-8785C, figures 10 and 11: at 1000 ft L_u = L_w = 1000 ft and all sigmas are 0.1 W20.
    assert lengths_m(304.8) == pytest.approx((304.8, 304.8), rel=1e-3)
    assert intensities_mps(304.8, 10.0) == pytest.approx((1.0, 1.0), rel=1e-3)
    # At 20 ft, computed by hand: 0.177 + 0.000823 * 20 = 0.19346; L_u = 20 / 0.19346^1.2 = 143.6 ft.
    assert lengths_m(6.096) == pytest.approx((143.6 * 0.3048, 6.096), rel=1e-3)
    assert intensities_mps(6.096, 10.0) == pytest.approx((1.929, 1.0), rel=1e-3)
    assert lengths_m(3000.0) == pytest.approx((533.4, 533.4))


def sampled(rate_hz, seconds, height_m=50.0, airspeed_mps=20.0, seed=3):
    wind = build(seed=seed, turbulence={"w20_mps": 10.0})
    return np.array(
        [
            wind.air_ned_mps(at(k / rate_hz, (0, 0, -height_m), (airspeed_mps, 0, 0)))
            for k in range(round(seconds * rate_hz))
        ]
    )


@pytest.mark.parametrize("rate_hz", [4, 20])
def test_dryden_has_the_standards_variance_at_any_step(rate_hz):
    sigma_u, sigma_w = intensities_mps(50.0, 10.0)
    deviations = np.mean(
        [np.sqrt((sampled(rate_hz, 500.0, airspeed_mps=60.0, seed=s) ** 2).mean(axis=0)) for s in range(4)],
        axis=0,
    )
    assert deviations == pytest.approx((sigma_u, sigma_u, sigma_w), rel=0.1)


def test_dryden_has_the_standards_autocorrelation():
    # R_u(tau) = exp(-V tau / L_u); R_w(tau) = exp(-x) (1 - x / 2), x = V tau / L_w.
    rate_hz, lag_s = 10, 1.0
    along, vertical = lengths_m(50.0)
    u, _, w = np.concatenate([sampled(rate_hz, 800.0, seed=s) for s in range(2)]).T
    lag = round(lag_s * rate_hz)
    x = 20.0 * lag_s / vertical
    assert np.corrcoef(u[:-lag], u[lag:])[0, 1] == pytest.approx(math.exp(-20.0 * lag_s / along), abs=0.05)
    assert np.corrcoef(w[:-lag], w[lag:])[0, 1] == pytest.approx(math.exp(-x) * (1 - x / 2), abs=0.05)


def hovering(speed_mps, seconds, step_s, seeds):
    """Wind at a point that stands 20 m above the ground: by seed, instant and axis."""
    parts = {"constant": {"speed_mps": speed_mps, "from_deg": 180}, "turbulence": {"level": "moderate"}}
    instants = np.arange(0.0, seconds, step_s)
    winds = (build(seed=seed, **parts) for seed in range(seeds))
    return np.array(
        [[wind.air_ned_mps(at(t, (0, 0, -20.0), (0.0, 0.0, 0.0))) for t in instants] for wind in winds]
    )


@pytest.mark.parametrize("speed_mps", [3.0, 8.0])
def test_turbulence_leaves_a_hovering_uas_mean_wind_as_it_is(speed_mps):
    seconds, seeds = 2000.0, 16
    along, _ = lengths_m(20.0)
    sigma_u, _ = intensities_mps(20.0, 30 * 1852 / 3600)
    means = hovering(speed_mps, seconds, 0.5, seeds).mean(axis=(0, 1))
    # Samples of an exponential correlation L / V are worth one in 2 L / V; v's is shorter.
    error = sigma_u * math.sqrt(2 * along / speed_mps / (seconds * seeds))
    assert means == pytest.approx((speed_mps, 0.0, 0.0), abs=2.5 * error)


@pytest.mark.slow
def test_turbulence_has_its_variance_in_still_air():
    seconds, seeds = 20000.0, 6
    along, _ = lengths_m(20.0)
    sigmas = intensities_mps(20.0, 30 * 1852 / 3600)
    variances = (hovering(0.0, seconds, 1.0, seeds) ** 2).mean(axis=(0, 1))
    error = math.sqrt(2 * along / AIRSPEED_MIN_MPS / (seconds * seeds))  # of a variance over itself
    expected = (sigmas[0] ** 2, sigmas[0] ** 2, sigmas[1] ** 2)
    assert variances == pytest.approx(expected, rel=2.5 * error)


GUST = {"start_s": 10, "rise_s": 1, "hold_s": 5, "fall_s": 1}


@pytest.mark.parametrize(
    "mean",
    [
        {"gusts": [{"speed_mps": 8, "from_deg": 260, **GUST}]},  # from still air and back
        {"constant": {"speed_mps": 4}, "gusts": [{"speed_mps": 8, "from_deg": 180, **GUST}]},  # through zero
        {
            "constant": {"speed_mps": 4},
            "gusts": [{"speed_mps": 8, "from_deg": 179, **GUST}],
        },  # just beside it
        {"constant": {"speed_mps": 4}, "gusts": [{"speed_mps": 8, "from_deg": 90, **GUST}]},  # turns
    ],
)
def test_turbulence_does_not_jump_where_the_mean_wind_turns(mean):
    step_s, height_m = 0.01, 50.0
    steady, turbulent = build(**mean), build(turbulence={"level": "moderate"}, **mean)
    points = [at(k * step_s, (0, 0, -height_m), (0.0, 0.0, 0.0)) for k in range(2500)]
    winds = np.array([steady.air_ned_mps(point) for point in points])
    parts = np.array([turbulent.air_ned_mps(point) for point in points]) - winds
    # R_v = exp(-x) (1 - x / 2), x = V t / L, so that a step has the variance 3 x sigma^2.
    travelled_m = max(np.linalg.norm(winds, axis=1).max(), AIRSPEED_MIN_MPS) * step_s
    sigmas, lengths = intensities_mps(height_m, 30 * 1852 / 3600), lengths_m(height_m)
    deviations = [s * math.sqrt(3 * travelled_m / length) for s, length in zip(sigmas, lengths, strict=True)]
    largest = np.abs(np.diff(parts, axis=0)).max(axis=0)
    assert (largest < 5 * np.array(deviations)[[0, 0, 1]]).all()


def test_turbulence_follows_a_mean_wind_that_turns():
    gust = {"speed_mps": 8, "from_deg": 330, "start_s": 0, "rise_s": 1, "hold_s": 1000}
    steady, turbulent = build(gusts=[gust]), build(gusts=[gust], turbulence={"w20_mps": 10.0})
    points = [at(k, (0, 0, -20.0), (0.0, 0.0, 0.0)) for k in range(200)]
    along, _ = lengths_m(20.0)
    for point in points:
        turbulent.air_ned_mps(point)
    assert steady.air_ned_mps(points[-1])[1] == pytest.approx(4.0)
    left_deg = math.degrees(turbulent._axis_rad) + 30.0  # blows towards 150 degrees, along the line of -30
    assert left_deg == pytest.approx(30.0 * math.exp(-199 * 8 / along), abs=0.1)


def test_turbulence_is_keyed_by_seed_and_ua():
    def first(seed, ua_id):
        wind = build(seed=seed, ua_id=ua_id, turbulence={"level": "light"})
        return [wind.air_ned_mps(at(k / 100)) for k in range(20)]

    assert first(1, 0) == first(1, 0)
    assert first(1, 0) != first(2, 0)
    assert first(1, 0) != first(1, 1)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("constant: {up_mps: 3}", r"mine.yaml:1: constant\.speed_mps: is required, and missing"),
        ("constant: {speed_mps: 3, fro_deg: 9}", "unknown key; did you mean from_deg"),
        ("{3: 4}", r"mine.yaml:1: 3: unknown key; allowed here: description, constant, "),
        (
            "constant: {speed_mps: 3, 4: 5}",
            r"mine.yaml:1: constant\.4: unknown key; allowed here: speed_mps, from_deg, up_mps",
        ),
        ("constant: {speed_mps: true}", r"mine.yaml:1: constant\.speed_mps: has to be a number \(got true\)"),
        ("turbulence: {}", "either level or w20_mps"),
        ("gusts: [{speed_mps: 1, start_s: 0, every_s: 1}]", "shorter than the gust"),
        ("a: [", "expected"),
        ("1", "has to be a mapping of keys to values"),
    ],
)
def test_a_wrong_file_is_explained(tmp_path, text, message):
    path = tmp_path / "mine.yaml"
    path.write_text(text)
    with pytest.raises(WindError, match=message):
        load_wind(path)


def test_a_wind_spelt_out_may_change_one_that_ships():
    gusty = load_wind("gusty")
    assert wind_from_mapping({"preset": "gusty"}) == gusty
    calmer = wind_from_mapping(
        {"preset": "gusty", "constant": {"speed_mps": 1.5}, "turbulence": {"w20_mps": 2}}
    )
    assert calmer.constant.speed_mps == 1.5
    assert calmer.constant.from_deg == gusty.constant.from_deg
    assert (calmer.turbulence.w20_mps, calmer.gusts) == (2, gusty.gusts)
    assert wind_from_mapping({"constant": {"speed_mps": 3}}).constant.speed_mps == 3
    with pytest.raises(WindError, match="no wind 'gutsy'; did you mean gusty"):
        wind_from_mapping({"preset": "gutsy"})


def test_an_unknown_wind_lists_the_known_ones():
    with pytest.raises(WindError, match=r"no wind 'storm'.*breeze, calm"):
        load_wind("storm")
