"""Thrust and torque commands to motor commands for a quad X in ArduCopter's motor order.

Motor 1 front right (CCW), 2 rear left (CCW), 3 front left (CW), 4 rear right (CW), seen from above. A
motor's command is its throttle 0..1; its PWM is 1000 + 1000 * command.
"""

from __future__ import annotations

MOTORS = 4
PWM_MIN_US = 1000
PWM_SPAN_US = 1000

MotorCommands = tuple[float, float, float, float]


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
    widest = max(abs(front_right), abs(front_left))
    room = 0.5 * (1.0 - lowest)
    if widest > room:
        shrink = room / widest
        front_right *= shrink
        front_left *= shrink
        widest = room
    half_yaw = max(widest - room, min(room - widest, 0.5 * yaw))
    reach = widest + abs(half_yaw)
    throttle = max(lowest + reach, min(1.0 - reach, throttle))
    return (
        throttle + front_right + half_yaw,
        throttle - front_right + half_yaw,
        throttle + front_left - half_yaw,
        throttle - front_left - half_yaw,
    )


def pwm_us(command: float) -> int:
    """Return the PWM in us for a motor command, limited to 1000..2000."""
    return PWM_MIN_US + round(PWM_SPAN_US * max(0.0, min(1.0, command)))
