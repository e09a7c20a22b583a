import math
from itertools import islice

import pytest
from pydantic import ValidationError
from pymavlink.dialects.v20 import common

from fdm.errors import ModelDivergedError
from fdm.model.air_point import StaticAir
from fdm.model.airframe import load_airframe
from fdm.model.geodesy import GeodeticPosition, Home
from fdm.model.jsbsim_model import JsbsimModel
from fdm.model.magnetic_field import magnetic_field_ned_gauss
from fdm.model.px4_sensors import Px4Encoder, Px4Sensors, pressure_altitude_m, to_body
from fdm.model.sensor_noise import SensorNoise
from fdm.model.truth import TrueState

HOME = Home(GeodeticPosition(47.3977, 8.5456, 488.0), 30.0)
EXACT = Px4Sensors(
    **{name: 0.0 for name in Px4Sensors.model_fields if "sigma" in name}  # type: ignore[arg-type]
)
STANDS = (0.0, 0.0, 0.0, 0.0, 0.0, -9.8, 3.0, 4.0, -5.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 20.0)


class StandardAir:
    """It flies north-east at 3000 m in the air of ISO 2533, nose up by 0.1 rad."""

    def air(self):
        return StaticAir(95_000.0, 285.15)

    def truth(self, ua_id, sim_time_ns):
        ahead, attitude = (16.0, 12.0, -1.0), (math.cos(0.05), 0.0, math.sin(0.05), 0.0)
        gyro, force, place = (0.1, 0.2, 0.3), (0.0, 1.0, -9.0), (47.5, 8.5, 3000.0)
        still = (0.0, 0.0, 0.0)
        return TrueState(ua_id, sim_time_ns, *place, still, ahead, attitude, gyro, force, 23.2, still)


def encoder(sensors=EXACT, *, home=HOME, seed=1, ua_id=0, has_airspeed=False):
    made = Px4Encoder(sensors, home, seed=seed, ua_id=ua_id, has_airspeed=has_airspeed)
    made.model = StandardAir()
    return made


def messages(made, frames=1, rate_hz=250, values=STANDS):
    data = b"".join(made((number / rate_hz, *values)) for number in range(1, frames + 1))
    return common.MAVLink(None).parse_buffer(data)


def of_type(found, name):
    return [message for message in found if message.get_type() == name]


# NOAA's test values for WMM2020 (WMM2020_TEST_VALUES.txt): date, height km, latitude, longitude, X, Y, Z in nT.
@pytest.mark.parametrize(
    ("year", "height_km", "lat_deg", "lon_deg", "expected_nt"),
    [
        (2020.0, 0, 80, 0, (6570.4, -146.3, 54606.0)),
        (2020.0, 0, 0, 120, (39624.3, 109.9, -10932.5)),
        (2022.5, 0, 0, 120, (39684.7, -42.2, -10809.5)),
    ],
)
def test_the_magnetic_field_is_that_of_noaa(year, height_km, lat_deg, lon_deg, expected_nt):
    unix_s = (year - 1970.0) * 31_556_952
    place = GeodeticPosition(lat_deg, lon_deg, height_km * 1000.0)
    field = magnetic_field_ned_gauss(place, unix_s)
    assert [component * 1e5 for component in field] == pytest.approx(expected_nt, abs=1.0)


def test_a_vector_in_the_body():
    assert to_body((1.0, 0.0, 0.0), 0.0, 0.0, math.pi / 2) == pytest.approx((0.0, -1.0, 0.0))  # looks east
    assert to_body((0.0, 0.0, 1.0), 0.0, math.pi / 2, 0.0) == pytest.approx((-1.0, 0.0, 0.0))  # looks up
    assert to_body((0.0, 0.0, 1.0), math.pi / 2, 0.0, 0.0) == pytest.approx(
        (0.0, 1.0, 0.0)
    )  # on its right side


def test_pressure_altitude_is_that_of_the_table():
    assert pressure_altitude_m(89_874.6) == pytest.approx(1000.0, abs=0.5)  # ISO 2533: 898.746 hPa at 1000 m
    assert pressure_altitude_m(54_019.9) == pytest.approx(5000.0, abs=0.5)


def test_a_standing_f450_is_in_standard_air():
    air = JsbsimModel(load_airframe("f450"), HOME).air()
    assert pressure_altitude_m(air.pressure_pa) == pytest.approx(488.15, abs=1.0)
    assert air.temperature_k == pytest.approx(288.15 - 0.0065 * 488.15, abs=0.05)


def test_sensors_come_at_their_rates_and_the_imu_is_last():
    found = messages(encoder(), frames=250)
    assert [len(of_type(found, name)) for name in ("HIL_SENSOR", "HIL_GPS", "HIL_STATE_QUATERNION")] == [
        250,
        10,
        50,
    ]
    assert [message.get_type() for message in found[:4]] == [
        "HIL_GPS", "HIL_STATE_QUATERNION", "HIL_SENSOR", "HIL_SENSOR"
    ]  # fmt: skip
    updated = [message.fields_updated for message in of_type(found, "HIL_SENSOR")]
    assert updated[:6] == [0x1BFF, 0x3F, 0x3F, 0x3F, 0x3F, 0x1BFF]


def test_what_exact_sensors_measure():
    found = messages(encoder(has_airspeed=True))
    (sensor,), (gps,) = of_type(found, "HIL_SENSOR"), of_type(found, "HIL_GPS")
    assert sensor.fields_updated == 0x1FFF
    assert sensor.zacc == pytest.approx(-9.8)
    assert (sensor.abs_pressure, sensor.temperature) == pytest.approx((950.0, 12.0))
    assert sensor.diff_pressure == pytest.approx(0.5 * 1.225 * 20.0**2 / 100.0)
    assert gps.time_usec == 1_700_000_000_004_000
    assert (gps.lat - 473977000, gps.alt) == (pytest.approx(3.0 / 0.0111319, abs=1), 493_000)


def test_the_truth_is_the_models():
    """Scales of HIL_STATE_QUATERNION: degrees 1e-7, mm, cm/s, mg. Density at 950 hPa and 12 C is 1.1606 kg/m^3."""
    noise = SensorNoise(position_sigma_m=5.0, gyro_sigma_radps=1.0, airspeed_sigma_mps=3.0)
    measured = noise.disturb(seed=1, ua_id=0)(lambda: STANDS)
    made = encoder(Px4Sensors(), has_airspeed=True)
    data = b"".join(made((number / 250, *measured())) for number in range(1, 251))
    found = of_type(common.MAVLink(None).parse_buffer(data), "HIL_STATE_QUATERNION")
    assert len(found) == 50
    for truth in found:
        assert (truth.lat, truth.lon, truth.alt) == (475_000_000, 85_000_000, 3_000_000)
        assert (truth.vx, truth.vy, truth.vz) == (1600, 1200, -100)
        assert truth.attitude_quaternion == pytest.approx([math.cos(0.05), 0.0, math.sin(0.05), 0.0])
        assert (truth.rollspeed, truth.pitchspeed, truth.yawspeed) == pytest.approx((0.1, 0.2, 0.3))
        assert (truth.xacc, truth.yacc, truth.zacc) == (0, 102, -918)
        assert (truth.true_airspeed, truth.ind_airspeed) == (2320, round(2320 * math.sqrt(1.1606 / 1.225)))


def test_the_truth_of_a_model_is_where_its_sensors_are():
    model = JsbsimModel(load_airframe("f450"), HOME)
    made = encoder(EXACT)
    made.model = model
    found = common.MAVLink(None).parse_buffer(made((0.004, *model.sense())))
    (truth,), (gps,) = (of_type(found, name) for name in ("HIL_STATE_QUATERNION", "HIL_GPS"))
    assert (truth.lat, truth.lon) == (pytest.approx(gps.lat, abs=1), pytest.approx(gps.lon, abs=1))
    assert truth.alt == pytest.approx(gps.alt, abs=1)
    assert truth.time_usec == 4000


def test_the_same_seed_gives_the_same_bytes_and_a_boot_too():
    made = encoder(Px4Sensors())
    first = [made((number / 250, *STANDS)) for number in range(5)]
    made.reset()
    assert [made((number / 250, *STANDS)) for number in range(5)] == first
    other, sibling = encoder(Px4Sensors(), seed=2), encoder(Px4Sensors(), ua_id=1)
    assert len({made((0.0, *STANDS)) for made in (other, sibling)} | {first[0]}) == 3


def test_errors_have_the_spread_that_was_asked_for():
    found = of_type(messages(encoder(Px4Sensors(accel_sigma_mps2=0.5)), frames=2000), "HIL_SENSOR")
    values = [message.xacc for message in islice(found, 2000)]
    assert sum(value * value for value in values) / 2000 == pytest.approx(
        0.25, rel=0.15
    )  # 4.7 sigma of chi^2


@pytest.mark.parametrize("lat_deg", [90.0, -90.0])
def test_a_fix_beyond_the_pole_is_at_the_pole(lat_deg):
    made = encoder(Px4Sensors(), home=Home(GeodeticPosition(lat_deg, 0.0, 0.0), 0.0))
    fixes = of_type(messages(made, frames=250, values=(0.0,) * len(STANDS)), "HIL_GPS")
    at_pole = [fix for fix in fixes if fix.lat == lat_deg * 1e7]
    assert len(fixes) == 10
    assert 1 < len(at_pole) < 10  # about half of the errors lead over it


def test_a_lost_model_is_told_and_not_sent():
    with pytest.raises(ModelDivergedError):
        encoder()((0.0, math.nan, *STANDS[1:]))


def test_rates_that_do_not_divide_that_of_the_imu_are_refused():
    with pytest.raises(ValidationError, match=r"gps_rate_hz\n  has to divide imu_rate_hz, 250 \(got 7\)"):
        Px4Sensors(gps_rate_hz=7)
