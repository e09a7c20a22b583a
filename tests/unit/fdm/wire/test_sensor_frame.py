import math
import re

import pytest

from fdm.errors import ModelDivergedError
from fdm.wire.sensor_frame import decode_sensor_frame, make_encoder

GYRO, FORCE = (0.1, -0.2, 0.3), (0.0, 0.0, -9.8)
POSITION, ATTITUDE, VELOCITY = (1.0, 2.0, -3.0), (0.01, -0.02, 3.1), (4.0, 5.0, -6.0)
VALUES = (0.0025, *GYRO, *FORCE, *POSITION, *ATTITUDE, *VELOCITY, 7.5)


def ardupilot_number(text, key, section=""):
    """As SIM_JSON.cpp: strstr(section), strstr(key), then atof at a fixed distance."""
    start = text.index(section) + len(section) + 1
    start = text.index(key, start) + len(key) + 2
    return float(re.match(r"\s*[-+.\deE]+", text[start:]).group())


def ardupilot_vector(text, key, section=""):
    """As SIM_JSON.cpp: sscanf("[%f, %f, %f]") at a fixed distance behind the key."""
    start = text.index(section) + len(section) + 1
    start = text.index(key, start) + len(key) + 2
    number = r"([-+.\deE]+)"
    return tuple(float(v) for v in re.match(rf"\[{number},\s*{number},\s*{number}\]", text[start:]).groups())


def test_the_bytes_are_those_that_ardupilots_parser_expects():
    assert make_encoder()(VALUES) == (
        b'\n{"timestamp":0.002500000,"imu":{"gyro":[0.1000000, -0.2000000, 0.3000000],'
        b'"accel_body":[0.000000, 0.000000, -9.800000]},"position":[1.00000, 2.00000, -3.00000],'
        b'"attitude":[0.01000000, -0.02000000, 3.10000000],"velocity":[4.000000, 5.000000, -6.000000],'
        b'"airspeed":7.50000,"no_time_sync":1}\n'
    )


def test_ardupilots_way_of_reading_finds_every_number():
    text = make_encoder(["windvane", "rangefinder"])((*VALUES, 12.5, 1.0, 8.0)).decode()
    assert ardupilot_number(text, "timestamp") == 0.0025
    assert ardupilot_vector(text, "gyro", "imu") == GYRO
    assert ardupilot_vector(text, "accel_body", "imu") == FORCE
    assert ardupilot_vector(text, "position") == POSITION
    assert ardupilot_vector(text, "attitude") == ATTITUDE
    assert ardupilot_vector(text, "velocity") == VELOCITY
    assert ardupilot_number(text, "airspeed") == 7.5
    assert ardupilot_number(text, "rng_1") == 12.5
    assert ardupilot_number(text, "direction", "windvane") == 1.0
    assert ardupilot_number(text, "speed", "windvane") == 8.0
    assert ardupilot_number(text, "no_time_sync") == 1


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e9])
def test_a_number_that_no_flight_gives_is_never_sent(value):
    with pytest.raises(ModelDivergedError):
        make_encoder()((*VALUES[:14], value, *VALUES[15:]))


def test_time_keeps_its_nanoseconds_after_a_day():
    time_ns = 86_400 * 10**9 + 833_333
    frame = decode_sensor_frame(make_encoder()((time_ns / 1e9, *VALUES[1:])))
    assert round(frame.timestamp_s * 1e9) == time_ns


def test_an_unknown_sensor_is_a_callers_mistake():
    with pytest.raises(ValueError, match="thermometer"):
        make_encoder(["thermometer"])
