"""The flight controller: references in, motor commands out, from sensor frames alone.

Position, velocity and the thrust wanted are worked out every ``OUTER_STEP_S``, attitude and rates at every
frame. The hover throttle is learned in flight from the vertical accelerometer, so that it fits other
multirotors.
"""

from __future__ import annotations

from math import sqrt, tan

from standin.control.attitude_control import AttitudeController
from standin.control.mixer import MotorCommands, MotorFrame
from standin.control.navigator import Navigator
from standin.control.position_control import (
    GRAVITY_MPS2,
    PositionController,
    throttle_for,
)
from standin.control.quaternion import (
    IDENTITY,
    Quaternion,
    Vector,
    attitude_for_thrust,
    quaternion_from_euler,
    thrust_axis_down,
    yaw_of,
)
from standin.wire.sensors import SensedFrame

OUTER_STEP_S = 0.01
HOVER_LEARNING_TIME_S = 3.0
HOVER_THROTTLE_MIN, HOVER_THROTTLE_MAX = 0.1, 0.8
LEARNING_FORCE_MIN_MPS2 = 4.0
LEARNING_HEIGHT_ERROR_M = 0.5
LEARNING_SPEED_ERROR_MPS = 0.3
LOWEST_COMMAND = 0.15
"""Of a motor in flight: one that stops may not start again in time."""
STEP_MAX_S = 0.05
"""A longer gap between frames is taken as this long by the loops (they would overreact)."""


class FlightController:
    """Cascaded controller of a multirotor."""

    def __init__(self, hover_throttle: float, frame: MotorFrame) -> None:
        self._mix = frame.mix
        self._motors = len(frame.motors)
        self._attitude = AttitudeController()
        self._position = PositionController()
        self.hover_throttle = hover_throttle
        """Mean motor command that carries the weight, 0..1."""
        self.throttle = 0.0
        """Mean motor command of the latest frame, 0..1."""
        self.tilt_max_rad = 0.5
        self.target: Quaternion = IDENTITY
        """Attitude wanted."""
        self._thrust_mps2 = (0.0, 0.0, -GRAVITY_MPS2)
        self._throttle_planned = 0.0
        self._yaw_rate_radps = 0.0

    def rest(self, frame: SensedFrame, command: float) -> MotorCommands:
        """Turn the motors evenly (0 = stopped) and forget all integrals: for the ground."""
        self._attitude.reset(frame.gyro_radps)
        self._position.reset()
        self.target = quaternion_from_euler(0.0, 0.0, yaw_of(frame.attitude_wxyz))
        self.throttle = command
        return (command,) * self._motors

    def spool(self, frame: SensedFrame, throttle: float, yaw_rad: float, step_s: float) -> MotorCommands:
        """Hold level at a throttle that is given: for leaving the ground."""
        self._position.reset()
        self._thrust_mps2 = (0.0, 0.0, -GRAVITY_MPS2)
        self.target = quaternion_from_euler(0.0, 0.0, yaw_rad)
        return self._hold_attitude(frame, throttle, 0.0, step_s)

    def plan(self, frame: SensedFrame, navigator: Navigator, step_s: float) -> None:
        """Run the outer loops: attitude and throttle that follow the references; learn the hover throttle."""
        vertical = navigator.vertical
        thrust = self._position.thrust(
            frame.position_ned_m,
            frame.velocity_ned_mps,
            navigator.horizontal,
            vertical,
            tan(self.tilt_max_rad),
            step_s,
        )
        # A vehicle that does not follow its vertical reference stands on the ground, or is at a limit.
        if (
            abs(vertical.down_m - frame.position_ned_m[2]) < LEARNING_HEIGHT_ERROR_M
            and abs(vertical.down_mps - frame.velocity_ned_mps[2]) < LEARNING_SPEED_ERROR_MPS
        ):
            self._learn_hover_throttle(frame, step_s)
        self._aim(frame, thrust, navigator.yaw_rad)
        self._yaw_rate_radps = navigator.yaw_rate_radps

    @property
    def planned_lift_mps2(self) -> float:
        """Upward part of the specific thrust planned; about 9.8 in steady flight."""
        return -self._thrust_mps2[2]

    def relax(self, frame: SensedFrame) -> None:
        """Forget the integrals and the lean: for a vehicle that is about to be found standing."""
        self._position.forget_horizontal()
        self._aim(frame, (0.0, 0.0, self._thrust_mps2[2]), yaw_of(frame.attitude_wxyz))

    def follow(self, frame: SensedFrame, step_s: float) -> MotorCommands:
        """Run the inner loops towards the attitude and throttle planned."""
        return self._hold_attitude(frame, self._throttle_planned, self._yaw_rate_radps, step_s)

    def lifted_off(self, frame: SensedFrame) -> None:
        """Take the present throttle and thrust as the first measure of the hover throttle."""
        force_mps2 = max(-frame.specific_force_mps2[2], LEARNING_FORCE_MIN_MPS2)
        self._set_hover_throttle(self.throttle * GRAVITY_MPS2 / force_mps2)

    def _aim(self, frame: SensedFrame, thrust_mps2: Vector, yaw_rad: float) -> None:
        north, east, down = thrust_mps2
        size = sqrt(north * north + east * east + down * down)
        self._thrust_mps2 = thrust_mps2
        self.target = attitude_for_thrust((north / size, east / size, down / size), yaw_rad)
        tilt_cos = thrust_axis_down(frame.attitude_wxyz)
        self._throttle_planned = throttle_for(thrust_mps2, tilt_cos, self.hover_throttle)

    def _hold_attitude(
        self, frame: SensedFrame, throttle: float, yaw_rate_radps: float, step_s: float
    ) -> MotorCommands:
        roll, pitch, yaw = self._attitude.update(
            frame.attitude_wxyz,
            frame.gyro_radps,
            self.target,
            yaw_rate_radps,
            STEP_MAX_S if step_s > STEP_MAX_S else step_s,
        )
        commands = self._mix(throttle, roll, pitch, yaw, LOWEST_COMMAND)
        self.throttle = sum(commands) / self._motors
        return commands

    def _learn_hover_throttle(self, frame: SensedFrame, step_s: float) -> None:
        force_mps2 = -frame.specific_force_mps2[2]
        if force_mps2 > LEARNING_FORCE_MIN_MPS2:
            measured = self.throttle * GRAVITY_MPS2 / force_mps2
            blend = min(step_s, STEP_MAX_S) / HOVER_LEARNING_TIME_S
            self._set_hover_throttle(self.hover_throttle + blend * (measured - self.hover_throttle))

    def _set_hover_throttle(self, throttle: float) -> None:
        self.hover_throttle = max(HOVER_THROTTLE_MIN, min(HOVER_THROTTLE_MAX, throttle))
