import math
import re
import site
import subprocess
import sys

import pytest

from fdm.errors import AirframeError, ModelDivergedError
from fdm.model.airframe import load_airframe
from fdm.model.geodesy import GeodeticPosition, Home, ned_from_geodetic
from fdm.model.jsbsim_model import JsbsimModel, substeps_at

HOME = Home(GeodeticPosition(47.0, 8.0, 400.0), 30.0)


def packet(*motors_us, rate_hz=400, channels=16):
    return (18458, rate_hz, 0, *motors_us, *(0,) * (channels - len(motors_us)))


def fly(model, fields, seconds):
    for _ in range(round(seconds * fields[1])):
        model.step(fields, fields[1])


@pytest.fixture
def model():
    return JsbsimModel(load_airframe("f450"), HOME)


def test_at_rest_it_stands_at_home_and_feels_the_ground(model):
    truth = model.truth(3, 17)
    assert (truth.ua_id, truth.sim_time_ns) == (3, 17)
    assert truth.specific_force_frd_mps2 == pytest.approx((0, 0, -9.806), abs=0.07)
    assert math.hypot(*truth.specific_force_frd_mps2) == pytest.approx(9.807, abs=0.005)
    assert truth.body_rates_frd_radps == pytest.approx((0, 0, 0), abs=1e-4)  # the Earth's turn
    assert truth.velocity_ned_mps == pytest.approx((0, 0, 0), abs=1e-4)
    assert truth.position_ned_m == pytest.approx((0, 0, -0.15), abs=0.01)
    assert truth.wind_ned_mps == (0, 0, 0)
    yaw_rad = 2 * math.atan2(truth.attitude_wxyz[3], truth.attitude_wxyz[0])
    assert math.degrees(yaw_rad) == pytest.approx(30.0, abs=0.1)


def test_it_goes_on_standing(model):
    before = model.truth(0, 0)
    fly(model, packet(1000, 1000, 1000, 1000), 2.0)
    after = model.truth(0, 0)
    assert after.position_ned_m == pytest.approx(before.position_ned_m, abs=1e-4)
    assert after.attitude_wxyz == pytest.approx(before.attitude_wxyz, abs=1e-4)


def test_the_frame_is_the_truth_on_ardupilots_scale(model):
    fly(model, packet(1600, 1600, 1590, 1590), 1.0)
    values, truth = model.sense(), model.truth(0, 0)
    place = GeodeticPosition(truth.lat_deg, truth.lon_deg, truth.alt_amsl_m)
    assert values[6:9] == pytest.approx(ned_from_geodetic(HOME.position, place), abs=1e-6)
    assert values[12:15] == truth.velocity_ned_mps
    assert values[8] < -1.0


def test_full_throttle_is_felt_as_thrust_over_mass_in_the_same_frame(model):
    # F450 hovers at about 0.41 of throttle: the specific force passes 9.8 m/s^2 upwards beyond it.
    fly(model, packet(1410, 1410, 1410, 1410), 1.0)
    assert model.sense()[5] == pytest.approx(-9.8, abs=0.5)
    fly(model, packet(1600, 1600, 1600, 1600), 1.0)
    climbing = model.sense()
    assert climbing[5] < -13.0
    assert climbing[14] < -2.0


@pytest.mark.parametrize(
    ("motors", "index", "sign"),
    [
        ((1550, 1650, 1650, 1550), 9, +1),  # more thrust on the left: rolls right
        ((1650, 1550, 1650, 1550), 10, +1),  # more thrust in front: pitches up
        ((1650, 1650, 1550, 1550), 2, +1),  # 1 and 2 turn counter-clockwise: yaws right
    ],
)
def test_motors_turn_it_as_ardupilots_x_frame_does(model, motors, index, sign):
    fly(model, packet(1600, 1600, 1600, 1600), 0.5)
    before = model.sense()[index]
    fly(model, packet(*motors), 0.1)
    assert sign * (model.sense()[index] - before) > 0.01


def test_a_channel_without_output_stops_its_motor(model):
    fly(model, packet(1600, 1600, 1600, 1600), 1.0)
    fly(model, packet(), 1.0)
    assert abs(model.sense()[5]) < 2.0  # it falls


def test_channels_above_sixteen_are_read_when_they_come():
    airframe = load_airframe("f450")
    channels = tuple(c.model_copy(update={"channel": c.channel + 16}) for c in airframe.channels)
    model = JsbsimModel(airframe.model_copy(update={"channels": channels}), HOME)
    fly(model, packet(*(0,) * 16, 1600, 1600, 1600, 1600, channels=32), 1.0)
    assert model.sense()[14] < -2.0
    fly(model, packet(1600, 1600, 1600, 1600), 1.0)  # only 16 channels now: no output on 17 to 20
    assert abs(model.sense()[5]) < 2.0


def test_slow_frames_are_split_so_that_the_ground_holds(model):
    assert substeps_at(100, 250) == 3
    assert substeps_at(250, 250) == 1
    assert substeps_at(1200, 250) == 1
    fly(model, packet(1000, 1000, 1000, 1000, rate_hz=100), 5.0)
    assert model.sense()[8] == pytest.approx(-0.15, abs=0.01)
    assert model.sense()[14] == pytest.approx(0.0, abs=1e-3)


def test_the_rate_decides_the_step(model):
    fly(model, packet(1600, 1600, 1600, 1600, rate_hz=800), 1.0)
    fast = model.sense()
    slow_model = JsbsimModel(load_airframe("f450"), HOME)
    fly(slow_model, packet(1600, 1600, 1600, 1600, rate_hz=400), 1.0)
    assert slow_model.sense()[8] == pytest.approx(fast[8], abs=0.02)
    assert fast[8] < -1.0


def test_wind_moves_it_and_is_told(model):
    calm_model = JsbsimModel(load_airframe("f450"), HOME)
    for each in (model, calm_model):
        fly(each, packet(1600, 1600, 1600, 1600), 0.5)
    model.set_wind((3.0, -4.0, 0.5))
    for each in (model, calm_model):
        fly(each, packet(1600, 1600, 1600, 1600), 1.0)
    truth, calm = model.truth(0, 0), calm_model.truth(0, 0)
    assert truth.wind_ned_mps == pytest.approx((3.0, -4.0, 0.5))
    assert truth.velocity_ned_mps[0] > calm.velocity_ned_mps[0] + 0.1
    assert truth.velocity_ned_mps[1] < calm.velocity_ned_mps[1] - 0.1
    relative = [v - w for v, w in zip(truth.velocity_ned_mps, truth.wind_ned_mps, strict=True)]
    assert truth.airspeed_mps == pytest.approx(math.hypot(*relative), rel=0.02)
    assert model.air_point(0).velocity_ned_mps == truth.velocity_ned_mps


def test_optional_sensors_follow_the_frame():
    airframe = load_airframe("f450").model_copy(update={"sensors": ("windvane", "rangefinder")})
    model = JsbsimModel(airframe, HOME)
    model.set_wind((-5.0, 0.0, 0.0))  # from the north; the nose looks to 30 degrees
    fly(model, packet(1000, 1000, 1000, 1000), 0.1)
    values = model.sense()
    assert len(values) == 16 + 3
    assert values[16] == pytest.approx(0.15, abs=0.01)
    assert values[17] == pytest.approx(math.radians(-30), abs=0.02)
    assert values[18] == pytest.approx(5.0, abs=0.1)


def test_jsbsims_own_files_are_found_wherever_it_is_installed(monkeypatch, tmp_path):
    monkeypatch.setattr(site, "getsitepackages", lambda: [str(tmp_path)])
    monkeypatch.setattr(site, "getusersitepackages", lambda: str(tmp_path))
    truth = JsbsimModel(load_airframe("f450"), HOME).truth(0, 0)
    assert truth.position_ned_m == pytest.approx((0, 0, -0.15), abs=0.01)


def test_a_model_that_is_not_there_is_an_airframe_error():
    airframe = load_airframe("f450")
    jsbsim = airframe.jsbsim.model_copy(update={"model": "nope"})
    with pytest.raises(AirframeError, match=r"JSBSim model nope: .*nope"):
        JsbsimModel(airframe.model_copy(update={"jsbsim": jsbsim}), HOME)


def test_a_property_that_is_not_there_is_an_airframe_error():
    airframe = load_airframe("f450")
    channel = airframe.channels[0].model_copy(update={"property": "fcs/nope"})
    with pytest.raises(AirframeError, match="has no property fcs/nope"):
        JsbsimModel(airframe.model_copy(update={"channels": (channel,)}), HOME)


@pytest.mark.parametrize("name", ["inertia/mass-slugs", "forces/fbz-total-lbs"])
def test_a_property_that_jsbsim_computes_is_an_airframe_error(name):
    airframe = load_airframe("f450")
    jsbsim = airframe.jsbsim.model_copy(update={"properties": {name: 0.1}})
    with pytest.raises(AirframeError, match=f"jsbsim.properties: JSBSim computes the property {name}"):
        JsbsimModel(airframe.model_copy(update={"jsbsim": jsbsim}), HOME)
    channel = airframe.channels[0].model_copy(update={"property": name})
    with pytest.raises(AirframeError, match=f"channels: JSBSim computes the property {name}"):
        JsbsimModel(airframe.model_copy(update={"channels": (channel,)}), HOME)


def with_model(folder, old, new, **settings):
    """The f450 with something else in its JSBSim model."""
    airframe = load_airframe("f450")
    text = (airframe.jsbsim.root / "aircraft" / "f450" / "f450.xml").read_text()
    assert old in text
    place = folder / "aircraft" / "mine" / "mine.xml"
    place.parent.mkdir(parents=True)
    place.write_text(text.replace(old, new))
    jsbsim = airframe.jsbsim.model_copy(update={"model": "mine", "root": folder, **settings})
    return airframe.model_copy(update={"jsbsim": jsbsim})


def with_flight_control(folder, components, min_rate_hz=250.0):
    """The f450 with one channel, of components of JSBSim's flight control, driven by servo channel 1."""
    control = f'<flight_control name="mine"><channel name="mine">{components}</channel></flight_control>'
    old = "<aerodynamics>"
    airframe = with_model(folder, old, control + old, min_rate_hz=min_rate_hz)
    channel = airframe.channels[0].model_copy(update={"property": "fcs/aileron-cmd-norm"})
    return airframe.model_copy(update={"channels": (channel,)})


@pytest.mark.parametrize(("rate_hz", "min_rate_hz"), [(400, 250.0), (400, 800.0), (800, 800.0), (250, 500.0)])
def test_lags_rate_limits_and_integrators_of_a_model_take_the_time_that_they_say(
    tmp_path, rate_hz, min_rate_hz
):
    told = "<input>fcs/aileron-cmd-norm</input>"
    airframe = with_flight_control(
        tmp_path,
        f'<lag_filter name="mine/lag">{told}<c1>5</c1></lag_filter>'
        f'<actuator name="mine/limited">{told}<rate_limit>0.5</rate_limit></actuator>'
        f'<integrator name="mine/integral">{told}<c1>1</c1></integrator>',
        min_rate_hz,
    )
    model = JsbsimModel(airframe, HOME)
    fly(model, packet(2000, rate_hz=rate_hz), 0.2)
    of = model._exec.get_property_value
    assert of("mine/lag") == pytest.approx(1 - math.exp(-5 * 0.2), abs=0.5 / rate_hz * 5)
    assert of("mine/limited") == pytest.approx(0.5 * 0.2, abs=1e-9)
    assert of("mine/integral") == pytest.approx(0.2, abs=1.0 / rate_hz)


def test_a_model_that_jsbsim_cannot_run_is_an_airframe_error(tmp_path):
    airframe = with_flight_control(
        tmp_path, '<pure_gain name="mine/gain"><input>mine/nope</input><gain>1</gain></pure_gain>'
    )
    with pytest.raises(AirframeError, match=r"JSBSim model mine does not run: .*mine/nope does not exist$"):
        JsbsimModel(airframe, HOME)


LATE = """\
import gc, sys
from pathlib import Path
from fdm.errors import ModelDivergedError
from fdm.model.airframe import load_airframe
from fdm.model.geodesy import GeodeticPosition, Home
from fdm.model.jsbsim_model import JsbsimModel

airframe = load_airframe("f450")
jsbsim = airframe.jsbsim.model_copy(update={"model": "mine", "root": Path(sys.argv[1])})
airframe = airframe.model_copy(update={"jsbsim": jsbsim})
model = JsbsimModel(airframe, Home(GeodeticPosition(47.0, 8.0, 400.0)))
try:
    for _ in range(800):
        model.step((18458, 400, 0, *(1000,) * 16), 400)
except ModelDivergedError as error:
    print(error)
del model
gc.collect()
"""


def test_a_model_that_throws_in_flight_ends_and_the_process_goes_on(tmp_path):
    late = "<ifthen> <lt> <property> simulation/sim-time-sec </property> <value> 4 </value> </lt> <value> 0 </value> "
    late += "<property> aero/nope </property> </ifthen>"
    with_model(tmp_path, "<property> aero/qbar-area </property>", late)
    done = subprocess.run([sys.executable, "-c", LATE, str(tmp_path)], capture_output=True, text=True)
    assert re.fullmatch(r"JSBSim stopped: .* The property aero/nope does not exist\n", done.stdout)
    assert (done.stderr, done.returncode) == ("", 0)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("1.4 </emptywt>", "0 </emptywt>", r"mine\.xml: the mass is 0 kg"),
        ("1.4 </emptywt>", "-1.4 </emptywt>", r"mine\.xml: the mass is -1\.4 kg"),
        ("0.0190", "0", "model mine left the finite numbers as it settled"),
        ("1.4 </emptywt>", "1400 </emptywt>", r"mine sank 0\.[0-9] m into the ground .* see its mass"),
    ],
)
def test_a_model_with_a_wrong_mass_or_inertia_is_an_airframe_error(tmp_path, old, new, says):
    with pytest.raises(AirframeError, match=says):
        JsbsimModel(with_model(tmp_path, old, new), HOME)


def test_jsbsims_console_is_silent(capfd):
    JsbsimModel(load_airframe("f450"), HOME)
    out, err = capfd.readouterr()
    assert (out, err) == ("", "")


def test_what_jsbsim_throws_ends_the_model(model):
    def explode():
        raise RuntimeError("floating point exception")

    model._run = explode
    with pytest.raises(ModelDivergedError, match="floating point"):
        model.step(packet(), 400)
