"""The control side of the stand-in: profiles, mixer, attitude algebra."""

from math import cos, hypot, pi, radians, sin

import pytest

from standin.control.mixer import HEXA_X, QUAD_X, UnknownFrameError, motor_frame, pwm_us
from standin.control.profile import HorizontalProfile, Limits, VerticalProfile
from standin.control.quaternion import (
    attitude_for_thrust,
    euler_from_quaternion,
    quaternion_from_euler,
    rotation_error,
    wrapped,
)

STEP_S = 0.01


@pytest.mark.parametrize("speed_mps", [5.0, 10.0, 15.0])
@pytest.mark.parametrize("jerk_mps3", [5.0, 10.0])
def test_profile_reaches_its_speed_and_its_point_without_overshoot(
    speed_mps: float, jerk_mps3: float
) -> None:
    limits = Limits(speed_mps, 2.5, jerk_mps3)
    profile = HorizontalProfile()
    fastest = 0.0
    for _ in range(7000):
        before = profile.north_mps2
        profile.step_to_position((150.0, -200.0), limits, STEP_S)
        fastest = max(fastest, hypot(profile.north_mps, profile.east_mps))
        assert hypot(profile.north_mps2, profile.east_mps2) <= 2.5 + 1e-9
        assert abs(profile.north_mps2 - before) <= jerk_mps3 * STEP_S + 1e-9
        assert hypot(profile.north_m, profile.east_m) < 250.02
    assert fastest == pytest.approx(speed_mps, abs=0.02)
    assert hypot(profile.north_m - 150.0, profile.east_m + 200.0) < 0.01


def test_profile_joins_a_new_target_without_a_jump() -> None:
    limits = Limits(10.0, 2.5, 10.0)
    profile = HorizontalProfile()
    for _ in range(800):
        profile.step_to_position((200.0, 0.0), limits, STEP_S)
    before = (profile.north_m, profile.north_mps, profile.north_mps2)
    profile.step_to_position((0.0, 100.0), limits, STEP_S)
    assert profile.north_m - before[0] < 0.11
    assert abs(profile.north_mps2 - before[2]) <= 0.1 + 1e-9
    for _ in range(4000):
        profile.step_to_position((0.0, 100.0), limits, STEP_S)
    assert (profile.north_m, profile.east_m) == pytest.approx((0.0, 100.0), abs=0.01)


def test_vertical_profile_keeps_its_speeds() -> None:
    limits = Limits(0.0, 1.0, 8.0)
    profile = VerticalProfile()
    rates = []
    for _ in range(3000):
        profile.step_to_position(-40.0, 2.5, 1.5, limits, STEP_S)
        rates.append(profile.down_mps)
    assert min(rates) == pytest.approx(-2.5, abs=0.01)
    assert profile.down_m == pytest.approx(-40.0, abs=0.01)
    rates.clear()
    for _ in range(4500):
        profile.step_to_position(0.0, 2.5, 1.5, limits, STEP_S)
        rates.append(profile.down_mps)
    assert max(rates) == pytest.approx(1.5, abs=0.01)
    assert profile.down_m == pytest.approx(0.0, abs=0.01)


def test_mixer_follows_the_motor_order_of_quad_x() -> None:
    front_right, rear_left, front_left, rear_right = QUAD_X.mix(0.5, 0.1, 0.0, 0.0, 0.1)
    assert front_left == rear_left > 0.5 > front_right == rear_right, "roll right lifts the left motors"
    front_right, rear_left, front_left, rear_right = QUAD_X.mix(0.5, 0.0, 0.1, 0.0, 0.1)
    assert front_left == front_right > 0.5 > rear_left == rear_right, "nose up lifts the front motors"
    front_right, rear_left, front_left, rear_right = QUAD_X.mix(0.5, 0.0, 0.0, 0.1, 0.1)
    assert front_right == rear_left > 0.5 > front_left == rear_right, "nose right speeds the CCW motors up"


@pytest.mark.parametrize("throttle", [0.0, 0.1, 0.5, 1.0])
@pytest.mark.parametrize("roll", [-1.0, 0.0, 0.3])
@pytest.mark.parametrize("pitch", [-0.2, 0.0, 1.0])
@pytest.mark.parametrize("yaw", [-1.0, 0.0, 0.5])
def test_mixer_stays_in_range_and_keeps_the_signs(
    throttle: float, roll: float, pitch: float, yaw: float
) -> None:
    one, two, three, four = QUAD_X.mix(throttle, roll, pitch, yaw, 0.15)
    for command in (one, two, three, four):
        assert 0.15 - 1e-9 <= command <= 1.0 + 1e-9
    assert ((two + three) - (one + four)) * roll >= -1e-9
    assert ((one + three) - (two + four)) * pitch >= -1e-9
    assert ((one + two) - (three + four)) * yaw >= -1e-9


def test_mixer_follows_the_motor_order_of_hexa_x() -> None:
    right, left, front_left, rear_right, front_right, rear_left = HEXA_X.mix(0.5, 0.1, 0.0, 0.0, 0.1)
    assert left > front_left == rear_left > 0.5 > front_right == rear_right > right, (
        "roll right lifts the left"
    )
    right, left, front_left, rear_right, front_right, rear_left = HEXA_X.mix(0.5, 0.0, 0.1, 0.0, 0.1)
    assert front_left == front_right > left == right == 0.5 > rear_left == rear_right, (
        "nose up lifts the front"
    )
    right, left, front_left, rear_right, front_right, rear_left = HEXA_X.mix(0.5, 0.0, 0.0, 0.1, 0.1)
    assert left == rear_right == front_right > 0.5 > right == front_left == rear_left, (
        "nose right: the CCW ones"
    )


@pytest.mark.parametrize("throttle", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("roll", [-1.0, 0.0, 0.3])
@pytest.mark.parametrize("pitch", [-0.2, 0.0, 1.0])
@pytest.mark.parametrize("yaw", [-1.0, 0.0, 0.5])
def test_hexa_mixer_stays_in_range_and_keeps_the_signs(
    throttle: float, roll: float, pitch: float, yaw: float
) -> None:
    commands = HEXA_X.mix(throttle, roll, pitch, yaw, 0.15)
    assert all(0.15 - 1e-9 <= command <= 1.0 + 1e-9 for command in commands)
    right, left, front_left, rear_right, front_right, rear_left = commands
    assert (left + front_left + rear_left - right - front_right - rear_right) * roll >= -1e-9
    assert (front_left + front_right - rear_left - rear_right) * pitch >= -1e-9
    assert (left + rear_right + front_right - right - front_left - rear_left) * yaw >= -1e-9


def test_frames_are_chosen_by_ardupilots_numbers() -> None:
    assert motor_frame(1, 1) is QUAD_X
    assert motor_frame(2.0, 1.0) is HEXA_X
    with pytest.raises(UnknownFrameError, match="FRAME_CLASS 3 with FRAME_TYPE 0: the stand-in flies"):
        motor_frame(3, 0)


def test_pwm_is_limited() -> None:
    assert pwm_us((0.0, 0.4144, 0.4146, 1.0)) == [1000, 1414, 1415, 2000]
    assert pwm_us((-1.0, 0.5, 3.0, 0.0)) == [1000, 1500, 2000, 1000]


@pytest.mark.parametrize("angles", [(0.1, -0.2, 3.0), (-1.0, 0.5, -2.0), (0.0, 0.0, 0.0)])
def test_euler_angles_survive_the_quaternion(angles: tuple[float, float, float]) -> None:
    assert euler_from_quaternion(quaternion_from_euler(*angles)) == pytest.approx(angles, abs=1e-12)


def test_rotation_error_is_in_body_axes_and_the_short_way() -> None:
    start = quaternion_from_euler(0.0, 0.0, 2.0)
    target = quaternion_from_euler(0.01, -0.02, 2.03)
    assert rotation_error(start, target) == pytest.approx((0.01, -0.02, 0.03), abs=1e-3)
    negated = tuple(-part for part in target)
    assert rotation_error(start, negated) == pytest.approx(rotation_error(start, target))  # type: ignore[arg-type]


def test_attitude_for_thrust_points_the_thrust_there() -> None:
    tilt, heading = radians(25.0), radians(70.0)
    direction = (sin(tilt) * cos(heading), sin(tilt) * sin(heading), -cos(tilt))
    w, x, y, z = attitude_for_thrust(direction, 1.0)
    body_z = (2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y))
    assert tuple(-part for part in body_z) == pytest.approx(direction)
    assert euler_from_quaternion((w, x, y, z))[2] == pytest.approx(1.0)


def test_wrapped() -> None:
    assert wrapped(3 * pi / 2) == pytest.approx(-pi / 2)
    assert wrapped(-pi) == pytest.approx(-pi)
