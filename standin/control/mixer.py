"""Thrust and torque commands to motor commands, for X frames in ArduCopter's motor orders.

A motor's command is its throttle 0..1; its PWM is 1000 + 1000 * command.
"""

from __future__ import annotations

from typing import NamedTuple

PWM_MIN_US = 1000
PWM_MAX_US = 2000

MotorCommands = tuple[float, ...]


class Motor(NamedTuple):
    """What a motor does for a torque of 1: its share of roll and pitch, and whether it turns the nose right."""

    roll: float
    pitch: float
    yaw_sign: float


class MotorFrame(NamedTuple):
    """A multirotor's motors, in the order of their outputs; the opposite of each has the signs turned."""

    motors: tuple[Motor, ...]

    def mix(self, throttle: float, roll: float, pitch: float, yaw: float, lowest: float) -> MotorCommands:
        """Return the motor commands.

        When they do not fit, roll and pitch are kept, then the throttle gives way, and yaw takes what is left.

        Args:
            throttle: mean command, 0..1.
            roll: roll torque, positive right side down, -1..1 (as ArduPilot scales it: half of it per motor).
            pitch: pitch torque, positive nose up.
            yaw: yaw torque, positive nose right.
            lowest: least command of a turning motor.
        """
        # Comparisons instead of max and min: this runs at every frame, and they are calls.
        tilts = [motor[0] * roll + motor[1] * pitch for motor in self.motors]
        widest, room, share = max(tilts), 0.5 * (1.0 - lowest), 1.0
        if widest > room:
            widest, share = room, room / widest
        half_yaw, spare = 0.5 * yaw, room - widest
        half_yaw = spare if half_yaw > spare else -spare if half_yaw < -spare else half_yaw
        reach = widest + (half_yaw if half_yaw > 0.0 else -half_yaw)
        highest, least = 1.0 - reach, lowest + reach
        throttle = highest if throttle > highest else throttle
        throttle = least if throttle < least else throttle
        return tuple(
            [throttle + share * tilt + motor[2] * half_yaw for tilt, motor in zip(tilts, self.motors)]  # noqa: B905
        )


QUAD_X = MotorFrame(
    (
        Motor(-0.5, 0.5, 1.0),  # front right, counter-clockwise seen from above: it turns the nose right
        Motor(0.5, -0.5, 1.0),  # rear left
        Motor(0.5, 0.5, -1.0),  # front left
        Motor(-0.5, -0.5, -1.0),  # rear right
    )
)
HEXA_X = MotorFrame(
    (
        Motor(-0.5, 0.0, -1.0),  # right
        Motor(0.5, 0.0, 1.0),  # left
        Motor(0.25, 0.5, -1.0),  # front left
        Motor(-0.25, -0.5, 1.0),  # rear right
        Motor(-0.25, 0.5, 1.0),  # front right
        Motor(0.25, -0.5, -1.0),  # rear left
    )
)
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
    return [
        PWM_MIN_US if command < 0.0 else PWM_MAX_US if command > 1.0 else int(1000.5 + 1000.0 * command)
        for command in commands
    ]
