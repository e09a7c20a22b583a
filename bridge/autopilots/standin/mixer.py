"""Thrust and torque commands to motor commands for a quad X in ArduCopter's motor order.

Motor 1 front right (CCW), 2 rear left (CCW), 3 front left (CW), 4 rear right (CW), seen from above. A
motor's command is its throttle 0..1; its PWM is 1000 + 1000 * command.
"""

from __future__ import annotations

MOTORS = 4
PWM_MIN_US = 1000
PWM_MAX_US = 2000

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


def pwm_us(commands: MotorCommands) -> list[int]:
    """Return the PWM in us for motor commands 0..1 (limited to 1000..2000)."""
    one, two, three, four = commands
    pwm = [
        int(1000.5 + 1000.0 * one),
        int(1000.5 + 1000.0 * two),
        int(1000.5 + 1000.0 * three),
        int(1000.5 + 1000.0 * four),
    ]
    if min(pwm) < PWM_MIN_US or max(pwm) > PWM_MAX_US:
        return [max(PWM_MIN_US, min(PWM_MAX_US, value)) for value in pwm]
    return pwm
