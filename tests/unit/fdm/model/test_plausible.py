import math

import pytest

from fdm.errors import ModelDivergedError
from fdm.model.plausible import FORCE_MAX_MPS2, RATE_MAX_RADPS, SPEED_MAX_MPS, plausible
from fdm.wire.sensor_frame import make_encoder
from standin.wire.sensors import parse_sensor_frame

RESTING = (0.0, 0.0, 0.0, 0.0, 0.0, -9.81, *(0.0,) * 10)


def frame(**changes):
    """A resting frame with some of its numbers changed: rate, force, down and speed along or about x."""
    places = {"rate": 0, "force": 3, "down": 8, "speed": 12}
    values = list(RESTING)
    for name, value in changes.items():
        values[places[name]] = value
    return tuple(values)


def last_of(*frames):
    """The last of what a model gives, as it is looked at."""
    given = iter(frames)
    sense = plausible(lambda: next(given))
    return [sense() for _ in frames][-1]


@pytest.mark.parametrize(
    "hard",
    [frame(speed=330.0), frame(rate=120.0), frame(force=5000.0), frame(down=3.0)],
)
def test_what_can_be_goes_through_unchanged(hard):
    assert last_of(RESTING, hard) == hard


@pytest.mark.parametrize("name", ["rate", "force", "speed", "down"])
@pytest.mark.parametrize("value", [math.nan, math.inf, 1e6])
def test_what_cannot_be_is_refused(name, value):
    with pytest.raises(ModelDivergedError, match="the flight model gave"):
        last_of(RESTING, frame(**{name: value}))


def test_an_impact_may_stop_an_aircraft_and_not_throw_it():
    hit, falling = frame(force=4000.0, speed=3.0), frame(speed=16.0)
    assert last_of(falling, hit) == hit
    with pytest.raises(
        ModelDivergedError, match=r"gave 27 m/s after an impact at 16 m/s: its ground contact"
    ):
        last_of(falling, hit, frame(force=4000.0, speed=-27.0))
    with pytest.raises(ModelDivergedError, match="27 m/s after an impact at 16 m/s"):
        last_of(falling, hit, frame(speed=27.0))  # it has left the ground


def test_an_aircraft_that_no_impact_moves_may_become_faster():
    faster = frame(speed=200.0, force=100.0)
    assert last_of(frame(speed=3.0), faster) == faster


def test_the_stand_in_takes_all_that_can_be():
    """What it cannot believe it drops without a word, which the clock takes for an autopilot that is silent."""
    most = (0.0, 0.0, RATE_MAX_RADPS, 0.0, FORCE_MAX_MPS2, *(0.0,) * 9, SPEED_MAX_MPS, SPEED_MAX_MPS)
    assert last_of(frame(speed=SPEED_MAX_MPS), most) == most
    assert parse_sensor_frame(make_encoder()((1.0, *most))) is not None
