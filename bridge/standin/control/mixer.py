"""Thrust and torque commands to motor commands, in ArduCopter's motor orders, seen from above.

Quad X: 1 front right (CCW), 2 rear left (CCW), 3 front left (CW), 4 rear right (CW). Hexa X: 1 right (CW), 2 left
(CCW), 3 front left (CW), 4 rear right (CCW), 5 front right (CCW), 6 rear left (CW). A motor's command is its throttle
0..1; its PWM is 1000 + 1000 * command.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

PWM_MIN_US = 1000
PWM_MAX_US = 2000

MotorCommands = tuple[float, ...]
Mixer = Callable[[float, float, float, float, float], MotorCommands]
"""From throttle, roll, pitch, yaw and the least command of a turning motor to the motors' commands."""


def mix_quad_x(throttle: float, roll: float, pitch: float, yaw: float, lowest: float) -> MotorCommands:
    """Return the four motor commands.

    When they do not fit, roll and pitch are kept, then the throttle gives way, and yaw takes what is left.

    Args:
        throttle: mean command, 0..1.
        roll: roll torque, positive right side down, -1..1 (as ArduPilot scales it: half of it per motor).
        pitch: pitch torque, positive nose up.
        yaw: yaw torque, positive nose right.
        lowest: least command of a turning motor.
    """
    front_right = 0.5 * (pitch - roll)
    front_left = 0.5 * (pitch + roll)
    # Opposite motors are antisymmetric: rear left = -front right, rear right = -front left.
    # (Conditional expressions, not max and min: this runs at every frame, and they cost a fifth.)
    size_right = front_right if front_right >= 0.0 else -front_right
    size_left = front_left if front_left >= 0.0 else -front_left
    widest = size_right if size_right > size_left else size_left
    room = 0.5 * (1.0 - lowest)
    if widest > room:
        front_right *= room / widest
        front_left *= room / widest
        widest = room
    left = room - widest
    half_yaw = 0.5 * yaw
    half_yaw = left if half_yaw > left else -left if half_yaw < -left else half_yaw
    reach = widest + (half_yaw if half_yaw >= 0.0 else -half_yaw)
    if throttle > 1.0 - reach:
        throttle = 1.0 - reach
    if throttle < lowest + reach:
        throttle = lowest + reach
    return (
        throttle + front_right + half_yaw,
        throttle - front_right + half_yaw,
        throttle + front_left - half_yaw,
        throttle - front_left - half_yaw,
    )


def mix_hexa_x(throttle: float, roll: float, pitch: float, yaw: float, lowest: float) -> MotorCommands:
    """Return the six motor commands; arguments and what gives way are as in `mix_quad_x`."""
    right = -0.5 * roll
    front_right = 0.5 * pitch - 0.25 * roll
    front_left = 0.5 * pitch + 0.25 * roll
    # Opposite motors are antisymmetric: left = -right, rear left = -front right, rear right = -front left.
    widest = max(abs(right), abs(front_right), abs(front_left))
    room = 0.5 * (1.0 - lowest)
    if widest > room:
        share = room / widest
        right, front_right, front_left = right * share, front_right * share, front_left * share
        widest = room
    half_yaw = min(max(0.5 * yaw, widest - room), room - widest)
    reach = widest + abs(half_yaw)
    throttle = max(min(throttle, 1.0 - reach), lowest + reach)
    return (
        throttle + right - half_yaw,
        throttle - right + half_yaw,
        throttle + front_left - half_yaw,
        throttle - front_left + half_yaw,
        throttle + front_right + half_yaw,
        throttle - front_right - half_yaw,
    )


@dataclass(frozen=True, slots=True)
class MotorFrame:
    """A multirotor's frame.

    Attributes:
        motors: how many it has.
        mix: its mixer.
    """

    motors: int
    mix: Mixer


QUAD_X = MotorFrame(4, mix_quad_x)
HEXA_X = MotorFrame(6, mix_hexa_x)
FRAMES = {(1, 1): QUAD_X, (2, 1): HEXA_X}
"""By ArduCopter's FRAME_CLASS and FRAME_TYPE."""


class UnknownFrameError(ValueError):
    """FRAME_CLASS and FRAME_TYPE name a frame that the stand-in cannot fly."""


def motor_frame(frame_class: float, frame_type: float) -> MotorFrame:
    """The frame that FRAME_CLASS and FRAME_TYPE name.

    Raises:
        UnknownFrameError: the stand-in has no mixer for it.
    """
    found = FRAMES.get((round(frame_class), round(frame_type)))
    if found is None:
        raise UnknownFrameError(
            f"FRAME_CLASS {frame_class:g} with FRAME_TYPE {frame_type:g}: the stand-in flies the X frames of a "
            "quadcopter (1, 1) and a hexacopter (2, 1)"
        )
    return found


def pwm_us(commands: MotorCommands) -> list[int]:
    """Return the PWM in us for motor commands 0..1 (limited to 1000..2000)."""
    pwm = [int(1000.5 + 1000.0 * command) for command in commands]
    if min(pwm) < PWM_MIN_US or max(pwm) > PWM_MAX_US:
        return [max(PWM_MIN_US, min(PWM_MAX_US, value)) for value in pwm]
    return pwm
