"""Aircraft that fall come to rest where they fell, with no more energy than they had."""

import math
from itertools import product

import pytest

from fdm.errors import ModelDivergedError
from fdm.model.airframe import airframe_names, load_airframe
from fdm.model.geodesy import GeodeticPosition, Home
from fdm.model.jsbsim_model import JsbsimModel
from fdm.model.plausible import plausible

HOME = Home(GeodeticPosition(47.0, 8.0, 0.0), 0.0)
GRAVITY = 9.81
MASS_KG = {"f450": 1.4, "hexa550": 2.1, "aerosonde": 11.0}
INERTIA_KG_M2 = {
    "f450": (0.019, 0.019, 0.0252),
    "hexa550": (0.0293, 0.0293, 0.0586),
    "aerosonde": (0.8244, 1.135, 1.759),
}
COPTERS = ("f450", "hexa550")
STILL = (0.0, 0.0, 0.0)
TUMBLING = (8.0, -5.0, 2.0)
LEVEL, SIDE, BACK, NOSE, ASKEW = (0, 0), (89, 0), (180, 0), (0, -89), (120, 20)
ATTITUDES = (LEVEL, SIDE, BACK, NOSE, ASKEW, (-135, 0), (45, 35), (0, 60), (0, 89))
DEPTH_MAX_M = 0.4
SETTLE_S = 8.0
"""From the first touch to rest."""
INTEGRATION = 0.03
"""Share of energy that JSBSim's Euler step of the turn rates may add to a tumbling body in the air."""


def placed(airframe, height_m, attitude_deg=LEVEL, rates=STILL, velocity_mps=STILL):
    """A model in the air, its motors off; rates about and velocity along the body's axes."""
    model = JsbsimModel(airframe, HOME)
    execute = model._exec
    execute["ic/h-agl-ft"] = height_m / 0.3048
    for axis, angle in zip(("phi", "theta"), attitude_deg, strict=True):
        execute[f"ic/{axis}-deg"] = angle
    for axis, value in zip("uvw", velocity_mps, strict=True):
        execute[f"ic/{axis}-fps"] = value / 0.3048
    for axis, value in zip("pqr", rates, strict=True):
        execute[f"ic/{axis}-rad_sec"] = value
    assert execute.run_ic()
    return model


def energy_j(name, frame):
    """Potential over home's level, of motion and of turning."""
    turning = sum(i * rate**2 for i, rate in zip(INERTIA_KG_M2[name], frame[0:3], strict=True)) / 2
    moving = MASS_KG[name] * sum(v**2 for v in frame[12:15]) / 2
    return MASS_KG[name] * GRAVITY * -frame[8] + moving + turning


def fall_to_rest(name, height_m, attitude_deg, rates=STILL, velocity_mps=STILL, rate_hz=400):
    """The frames of a fall, which is held to the arithmetic; the last is at rest."""
    model = placed(load_airframe(name), height_m, attitude_deg, rates, velocity_mps)
    sense, packet = plausible(model.sense), (18458, rate_hz, 0, *(0,) * 16)
    frames = [sense()]
    most_j = energy_j(name, frames[0]) * (1 + INTEGRATION) + 0.1
    # A fall takes sqrt(2 h / g), and sqrt(2) of that if drag is half the weight on the average.
    last_s = math.sqrt(2) * math.sqrt(2 * height_m / GRAVITY) + SETTLE_S
    for _ in range(round(last_s * rate_hz)):
        model.step(packet, rate_hz)
        frames.append(sense())
        assert energy_j(name, frames[-1]) <= most_j
        assert -frames[-1][8] > -DEPTH_MAX_M
    assert math.hypot(*frames[-1][12:15]) < 0.05
    assert math.hypot(*frames[-1][0:3]) < 0.1
    assert -frames[-1][8] < 0.5
    return frames


def assert_no_bounce_is_higher(frames, height_m, speed_mps):
    """What is thrown up after the first touch stays below the height that its energy was worth."""
    touch = next(i for i, frame in enumerate(frames) if math.hypot(*frame[3:6]) > 50.0)
    highest = max(-frame[8] for frame in frames[touch:])
    assert highest < 0.5 + 0.5 * (height_m + speed_mps**2 / (2 * GRAVITY))


def test_the_masses_are_those_of_the_airframes_that_ship():
    assert set(MASS_KG) == set(airframe_names())
    for name in airframe_names():
        model = JsbsimModel(load_airframe(name), HOME)
        assert model._exec["inertia/mass-slugs"] * 14.5939 == pytest.approx(MASS_KG[name], rel=1e-4)


@pytest.mark.parametrize("attitude_deg", [LEVEL, SIDE, BACK, ASKEW])
@pytest.mark.parametrize("name", COPTERS)
def test_a_copter_whose_motors_stop_at_15_m_comes_to_rest(name, attitude_deg):
    frames = fall_to_rest(name, 15.0, attitude_deg, TUMBLING)
    assert_no_bounce_is_higher(frames, 15.0, 0.0)
    # Without drag it would hit at sqrt(2 g h) = 17.2 m/s; contact makes nothing faster.
    assert max(math.hypot(*frame[12:15]) for frame in frames) < math.sqrt(2 * GRAVITY * 15.0)


@pytest.mark.parametrize("rate_hz", [100, 250, 1200])
def test_a_copter_comes_to_rest_at_any_rate(rate_hz):
    frames = fall_to_rest("f450", 5.0, BACK, TUMBLING, (6.0, 0.0, 0.0), rate_hz)
    assert_no_bounce_is_higher(frames, 5.0, 6.0)


@pytest.mark.parametrize(("attitude_deg", "speed_mps"), [((0, -89), 30.0), ((180, -45), 20.0), (SIDE, 0.0)])
def test_a_fixed_wing_comes_to_rest_after_a_dive(attitude_deg, speed_mps):
    frames = fall_to_rest("aerosonde", 25.0, attitude_deg, velocity_mps=(speed_mps, 0.0, 0.0))
    assert_no_bounce_is_higher(frames, 25.0, speed_mps)


def test_a_crash_is_the_same_again():
    assert fall_to_rest("f450", 3.0, ASKEW, TUMBLING) == fall_to_rest("f450", 3.0, ASKEW, TUMBLING)


def long(*values):
    return [pytest.param(value, marks=pytest.mark.long) for value in values]


@pytest.mark.slow
@pytest.mark.parametrize("rate_hz", [100, *long(400, 1200)])
@pytest.mark.parametrize("height_m", [2.0, 40.0, *long(0.5, 100.0)])
@pytest.mark.parametrize("name", COPTERS)
def test_copters_come_to_rest_from_anywhere(name, height_m, rate_hz):
    cases = product(ATTITUDES, (STILL, (20.0, 0.0, -8.0)), (STILL, (12.0, -3.0, 0.0)))
    for attitude_deg, rates, velocity_mps in cases:
        fall_to_rest(name, height_m, attitude_deg, rates, velocity_mps, rate_hz)


@pytest.mark.slow
@pytest.mark.parametrize("rate_hz", [100, 400, *long(1200)])
@pytest.mark.parametrize("speed_mps", [0.0, 20.0, 50.0])
def test_the_fixed_wing_comes_to_rest_from_any_dive(speed_mps, rate_hz):
    for attitude_deg, height_m in product(((0, -89), (180, -89), (180, -60), (180, -30)), (10.0, 40.0)):
        fall_to_rest("aerosonde", height_m, attitude_deg, STILL, (speed_mps, 0.0, 0.0), rate_hz)


def on_wheels(**differences):
    """The F450 as the jsbsim package has it, whose feet are wheels and whose arms touch nothing."""
    airframe = load_airframe("f450")
    jsbsim = airframe.jsbsim.model_copy(update={"model": "F450", "root": None, **differences})
    return airframe.model_copy(update={"jsbsim": jsbsim})


@pytest.mark.parametrize(
    ("attitude_deg", "rates", "reason"),
    [
        (LEVEL, TUMBLING, r"m/s after an impact at 16\.\d m/s: its ground contact"),
        (SIDE, STILL, "it has diverged"),
        (BACK, STILL, "below the ground: it has no contact"),
    ],
)
def test_a_model_that_the_ground_throws_or_does_not_hold_is_told_at_once(attitude_deg, rates, reason):
    model = placed(on_wheels(), 15.0, attitude_deg, rates)
    sense = plausible(model.sense)

    def fall():
        for _ in range(1000):
            model.step((18458, 400, 0, *(0,) * 16), 400)
            assert math.hypot(*sense()[12:15]) < 17.2 + 10.0  # what it told of before

    with pytest.raises(ModelDivergedError, match=reason):
        fall()
