"""Builders of the messages that can be streamed or requested: the vehicle's state in MAVLink's units."""

from __future__ import annotations

from collections.abc import Callable
from math import atan2, degrees, hypot, nan

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridge.standin.control.quaternion import euler_from_quaternion
from bridge.standin.vehicle.arming import ESTIMATE_AFTER_S, GPS_FIX_AFTER_S
from bridge.standin.vehicle.vehicle import Vehicle, heading_deg
from bridge.standin.wire.mavlink_codec import Message

FIRMWARE_VERSION = (4, 6, 0)
"""The ArduCopter release whose behaviour the stand-in follows."""
FIRMWARE_TYPE_OFFICIAL = 255
SATELLITES = 10
SENSORS = (
    dialect.MAV_SYS_STATUS_SENSOR_3D_GYRO
    | dialect.MAV_SYS_STATUS_SENSOR_3D_ACCEL
    | dialect.MAV_SYS_STATUS_SENSOR_3D_MAG
    | dialect.MAV_SYS_STATUS_SENSOR_ABSOLUTE_PRESSURE
    | dialect.MAV_SYS_STATUS_SENSOR_GPS
    | dialect.MAV_SYS_STATUS_SENSOR_ANGULAR_RATE_CONTROL
    | dialect.MAV_SYS_STATUS_SENSOR_ATTITUDE_STABILIZATION
    | dialect.MAV_SYS_STATUS_SENSOR_YAW_POSITION
    | dialect.MAV_SYS_STATUS_SENSOR_Z_ALTITUDE_CONTROL
    | dialect.MAV_SYS_STATUS_SENSOR_XY_POSITION_CONTROL
    | dialect.MAV_SYS_STATUS_SENSOR_MOTOR_OUTPUTS
    | dialect.MAV_SYS_STATUS_AHRS
    | dialect.MAV_SYS_STATUS_SENSOR_BATTERY
    | dialect.MAV_SYS_STATUS_PREARM_CHECK
)
NEEDS_ESTIMATE = dialect.MAV_SYS_STATUS_AHRS | dialect.MAV_SYS_STATUS_PREARM_CHECK
EKF_FLAGS_READY = (
    dialect.EKF_ATTITUDE
    | dialect.EKF_VELOCITY_HORIZ
    | dialect.EKF_VELOCITY_VERT
    | dialect.EKF_POS_HORIZ_REL
    | dialect.EKF_POS_HORIZ_ABS
    | dialect.EKF_POS_VERT_ABS
    | dialect.EKF_PRED_POS_HORIZ_REL
    | dialect.EKF_PRED_POS_HORIZ_ABS
)
CAPABILITIES = (
    dialect.MAV_PROTOCOL_CAPABILITY_MISSION_INT
    | dialect.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
    | dialect.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
    | dialect.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_GLOBAL_INT
    | dialect.MAV_PROTOCOL_CAPABILITY_MAVLINK2
    | dialect.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST
)
_MAV_TYPES = {4: dialect.MAV_TYPE_QUADROTOR, 6: dialect.MAV_TYPE_HEXAROTOR}
"""By the number of motors."""
SEA_LEVEL_PRESSURE_HPA = 1013.25
POSITION_TARGET_MASK = 0x0DF8  # only the position is meaningful
UNKNOWN_16 = 0xFFFF


class Telemetry:
    """Builds messages from a vehicle."""

    def __init__(self, vehicle: Vehicle, boot_unix_us: int) -> None:
        self._vehicle = vehicle
        self._boot_unix_us = boot_unix_us
        self.builders: dict[int, Callable[[], Message | None]] = {
            dialect.MAVLINK_MSG_ID_HEARTBEAT: self.heartbeat,
            dialect.MAVLINK_MSG_ID_SYS_STATUS: self.sys_status,
            dialect.MAVLINK_MSG_ID_SYSTEM_TIME: self.system_time,
            dialect.MAVLINK_MSG_ID_GPS_RAW_INT: self.gps_raw_int,
            dialect.MAVLINK_MSG_ID_ATTITUDE: self.attitude,
            dialect.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: self.attitude_quaternion,
            dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED: self.local_position_ned,
            dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: self.global_position_int,
            dialect.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: self.servo_output_raw,
            dialect.MAVLINK_MSG_ID_RC_CHANNELS: self.rc_channels,
            dialect.MAVLINK_MSG_ID_MISSION_CURRENT: self.mission_current,
            dialect.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT: self.nav_controller_output,
            dialect.MAVLINK_MSG_ID_VFR_HUD: self.vfr_hud,
            dialect.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED: self.position_target_local_ned,
            dialect.MAVLINK_MSG_ID_POSITION_TARGET_GLOBAL_INT: self.position_target_global_int,
            dialect.MAVLINK_MSG_ID_SCALED_PRESSURE: self.scaled_pressure,
            dialect.MAVLINK_MSG_ID_RAW_IMU: self.raw_imu,
            dialect.MAVLINK_MSG_ID_BATTERY_STATUS: self.battery_status,
            dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION: self.autopilot_version,
            dialect.MAVLINK_MSG_ID_WIND: self.wind,
            dialect.MAVLINK_MSG_ID_EKF_STATUS_REPORT: self.ekf_status_report,
            dialect.MAVLINK_MSG_ID_HOME_POSITION: self.home_position,
            dialect.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: self.gps_global_origin,
            dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: self.extended_sys_state,
        }
        """Per message id: returns the message, or None if there is nothing to say yet."""

    @property
    def _boot_ms(self) -> int:
        return (self._vehicle.sim_time_ns // 1_000_000) & 0xFFFFFFFF

    @property
    def _unix_us(self) -> int:
        return self._boot_unix_us + self._vehicle.sim_time_ns // 1000

    @property
    def _estimate(self) -> bool:
        return self._vehicle.uptime_s >= ESTIMATE_AFTER_S

    def heartbeat(self) -> Message:
        """HEARTBEAT: mode, arming, state."""
        vehicle = self._vehicle
        base_mode = (
            dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
            | dialect.MAV_MODE_FLAG_STABILIZE_ENABLED
            | dialect.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED
        )
        if vehicle.mode.guided_flag:
            base_mode |= dialect.MAV_MODE_FLAG_GUIDED_ENABLED
        if vehicle.armed:
            base_mode |= dialect.MAV_MODE_FLAG_SAFETY_ARMED
        state = dialect.MAV_STATE_STANDBY if vehicle.landed else dialect.MAV_STATE_ACTIVE
        return dialect.MAVLink_heartbeat_message(
            _MAV_TYPES[vehicle.motor_count],
            dialect.MAV_AUTOPILOT_ARDUPILOTMEGA,
            base_mode,
            int(vehicle.mode.number),
            state,
            3,
        )

    def sys_status(self) -> Message:
        """SYS_STATUS: sensors' health with the PREARM_CHECK bit, battery."""
        vehicle = self._vehicle
        battery = vehicle.battery
        health = SENSORS & ~dialect.MAV_SYS_STATUS_PREARM_CHECK
        if not self._estimate:
            health &= ~NEEDS_ESTIMATE
        if vehicle.uptime_s < GPS_FIX_AFTER_S:
            health &= ~dialect.MAV_SYS_STATUS_SENSOR_GPS
        if vehicle.ready_to_arm():
            health |= dialect.MAV_SYS_STATUS_PREARM_CHECK
        enabled = SENSORS if vehicle.armed else SENSORS & ~dialect.MAV_SYS_STATUS_SENSOR_MOTOR_OUTPUTS
        return dialect.MAVLink_sys_status_message(
            SENSORS,
            enabled,
            health,
            0,
            round(battery.voltage_v * 1000),
            round(battery.current_a * 100),
            round(100 * battery.remaining(vehicle.parameters["BATT_CAPACITY"])),
            0,
            0,
            0,
            0,
            0,
            0,
        )

    def system_time(self) -> Message:
        """SYSTEM_TIME."""
        return dialect.MAVLink_system_time_message(self._unix_us, self._boot_ms)

    def gps_raw_int(self) -> Message:
        """GPS_RAW_INT: RTK-fixed, as ArduPilot's simulated GPS says."""
        vehicle = self._vehicle
        if vehicle.uptime_s < GPS_FIX_AFTER_S:
            fix, satellites, location = dialect.GPS_FIX_TYPE_NO_FIX, 0, vehicle.origin
        else:
            fix, satellites, location = dialect.GPS_FIX_TYPE_RTK_FIXED, SATELLITES, vehicle.location
        north, east, _ = vehicle.velocity_ned_mps
        speed_mps = hypot(north, east)
        course_deg = 0.0 if speed_mps < 0.1 else heading_deg(_course_rad(north, east))
        return dialect.MAVLink_gps_raw_int_message(
            self._vehicle.sim_time_ns // 1000,
            fix,
            location.lat_e7,
            location.lon_e7,
            round(location.alt_amsl_m * 1000),
            121,
            200,
            min(round(speed_mps * 100), UNKNOWN_16),
            round(course_deg * 100) % 36000,
            satellites,
        )

    def attitude(self) -> Message:
        """ATTITUDE."""
        roll, pitch, yaw = self._vehicle.attitude_rad
        return dialect.MAVLink_attitude_message(self._boot_ms, roll, pitch, yaw, *self._rates())

    def attitude_quaternion(self) -> Message:
        """ATTITUDE_QUATERNION."""
        frame = self._vehicle.frame
        attitude = frame.attitude_wxyz if frame else (1.0, 0.0, 0.0, 0.0)
        return dialect.MAVLink_attitude_quaternion_message(self._boot_ms, *attitude, *self._rates())

    def local_position_ned(self) -> Message | None:
        """LOCAL_POSITION_NED from the origin; nothing before there is an estimate."""
        if not self._estimate:
            return None
        vehicle = self._vehicle
        return dialect.MAVLink_local_position_ned_message(
            self._boot_ms, *vehicle.position_ned_m, *vehicle.velocity_ned_mps
        )

    def global_position_int(self) -> Message:
        """GLOBAL_POSITION_INT."""
        vehicle = self._vehicle
        location = vehicle.location
        north, east, down = vehicle.velocity_ned_mps
        return dialect.MAVLink_global_position_int_message(
            self._boot_ms,
            location.lat_e7,
            location.lon_e7,
            round(location.alt_amsl_m * 1000),
            round(vehicle.alt_rel_m * 1000),
            _int16(north * 100),
            _int16(east * 100),
            _int16(down * 100),
            round(heading_deg(vehicle.attitude_rad[2]) * 100) % 36000,
        )

    def servo_output_raw(self) -> Message:
        """SERVO_OUTPUT_RAW, 16 channels."""
        outputs = self._vehicle.servo_output_us
        time_us = (self._vehicle.sim_time_ns // 1000) & 0xFFFFFFFF
        return dialect.MAVLink_servo_output_raw_message(time_us, 0, *outputs[:8], *outputs[8:16])

    def rc_channels(self) -> Message:
        """RC_CHANNELS: the overrides."""
        channels = self._vehicle.rc.channels_us
        return dialect.MAVLink_rc_channels_message(
            self._boot_ms, len(channels), *channels, *([0] * (18 - len(channels))), 0
        )

    def mission_current(self) -> Message:
        """MISSION_CURRENT."""
        vehicle = self._vehicle
        mission = vehicle.mission
        total = max(len(mission) - 1, 0)
        if total == 0:
            state = dialect.MISSION_STATE_NO_MISSION
        elif vehicle.mode.name == "AUTO" and vehicle.armed:
            state = dialect.MISSION_STATE_ACTIVE
        else:
            state = (
                dialect.MISSION_STATE_NOT_STARTED if mission.current == 0 else dialect.MISSION_STATE_PAUSED
            )
        in_mission = 1 if vehicle.mode.name == "AUTO" else 2
        return dialect.MAVLink_mission_current_message(mission.current, total, state, in_mission)

    def nav_controller_output(self) -> Message | None:
        """NAV_CONTROLLER_OUTPUT: attitude wanted, bearing and distance to the target."""
        vehicle = self._vehicle
        frame = vehicle.frame
        if frame is None:
            return None
        target = _wanted_deg(vehicle)
        bearing = round(degrees(vehicle.navigator.bearing_rad(frame)))
        distance = min(round(vehicle.navigator.distance_m(frame)), UNKNOWN_16)
        climb_m = vehicle.position_ned_m[2] - vehicle.navigator.target_ned_m()[2]
        return dialect.MAVLink_nav_controller_output_message(
            target[0],
            target[1],
            round(target[2]),
            bearing,
            distance,
            climb_m if vehicle.armed else 0.0,
            0.0,
            0.0,
        )

    def vfr_hud(self) -> Message:
        """VFR_HUD: height above sea level, as ArduCopter sends."""
        vehicle = self._vehicle
        north, east, down = vehicle.velocity_ned_mps
        groundspeed_mps = hypot(north, east)
        airspeed_mps = vehicle.frame.airspeed_mps if vehicle.frame else None
        throttle = round(100 * vehicle.controller.throttle) if vehicle.armed else 0
        return dialect.MAVLink_vfr_hud_message(
            groundspeed_mps if airspeed_mps is None else airspeed_mps,
            groundspeed_mps,
            round(heading_deg(vehicle.attitude_rad[2])) % 360,
            throttle,
            vehicle.location.alt_amsl_m,
            -down,
        )

    def position_target_local_ned(self) -> Message:
        """POSITION_TARGET_LOCAL_NED: the navigator's target."""
        return dialect.MAVLink_position_target_local_ned_message(
            self._boot_ms,
            dialect.MAV_FRAME_LOCAL_NED,
            POSITION_TARGET_MASK,
            *self._vehicle.navigator.target_ned_m(),
            *(0.0,) * 8,
        )

    def position_target_global_int(self) -> Message:
        """POSITION_TARGET_GLOBAL_INT: the navigator's target."""
        vehicle = self._vehicle
        location = vehicle.origin.offset(*vehicle.navigator.target_ned_m())
        return dialect.MAVLink_position_target_global_int_message(
            self._boot_ms,
            dialect.MAV_FRAME_GLOBAL,
            POSITION_TARGET_MASK,
            location.lat_e7,
            location.lon_e7,
            location.alt_amsl_m,
            *(0.0,) * 8,
        )

    def scaled_pressure(self) -> Message:
        """SCALED_PRESSURE: the standard atmosphere's at this height."""
        alt_m = max(-1000.0, min(11000.0, self._vehicle.location.alt_amsl_m))
        pressure_hpa = SEA_LEVEL_PRESSURE_HPA * (1.0 - 2.25577e-5 * alt_m) ** 5.25588
        temperature_cdeg = round((15.0 - 0.0065 * alt_m) * 100)
        return dialect.MAVLink_scaled_pressure_message(self._boot_ms, pressure_hpa, 0.0, temperature_cdeg, 0)

    def raw_imu(self) -> Message:
        """RAW_IMU in milli-g and mrad/s, as ArduPilot sends it (no magnetometer)."""
        frame = self._vehicle.frame
        force = frame.specific_force_mps2 if frame else (0.0, 0.0, 0.0)
        return dialect.MAVLink_raw_imu_message(
            self._vehicle.sim_time_ns // 1000,
            *(_int16(value * 1000 / 9.80665) for value in force),
            *(_int16(value * 1000) for value in self._rates()),
            0,
            0,
            0,
        )

    def battery_status(self) -> Message:
        """BATTERY_STATUS of the one battery."""
        vehicle = self._vehicle
        battery = vehicle.battery
        voltages = [round(battery.voltage_v * 1000)] + [UNKNOWN_16] * 9
        return dialect.MAVLink_battery_status_message(
            0,
            dialect.MAV_BATTERY_FUNCTION_UNKNOWN,
            dialect.MAV_BATTERY_TYPE_UNKNOWN,
            32767,
            voltages,
            round(battery.current_a * 100),
            round(battery.used_mah),
            -1,
            round(100 * battery.remaining(vehicle.parameters["BATT_CAPACITY"])),
        )

    def autopilot_version(self) -> Message:
        """AUTOPILOT_VERSION: the version followed; the custom version says that this is the stand-in."""
        major, minor, patch = FIRMWARE_VERSION
        version = major << 24 | minor << 16 | patch << 8 | FIRMWARE_TYPE_OFFICIAL
        custom = list(b"standin\0")
        return dialect.MAVLink_autopilot_version_message(
            CAPABILITIES, version, 0, 0, 0, custom, custom, custom, 0, 0, 0
        )

    def wind(self) -> Message:
        """WIND: where it comes from, its speed."""
        wind = self._vehicle.wind
        speed_mps = hypot(wind.north_mps, wind.east_mps)
        direction_deg = degrees(_course_rad(-wind.north_mps, -wind.east_mps)) if speed_mps > 0.0 else 0.0
        return dialect.MAVLink_wind_message(direction_deg, speed_mps, 0.0)

    def ekf_status_report(self) -> Message:
        """EKF_STATUS_REPORT: flags only, the stand-in has no filter."""
        flags = EKF_FLAGS_READY if self._estimate else dialect.EKF_UNINITIALIZED
        return dialect.MAVLink_ekf_status_report_message(flags, 0.0, 0.0, 0.0, 0.0, 0.0)

    def home_position(self) -> Message | None:
        """HOME_POSITION, once home is set."""
        vehicle = self._vehicle
        if vehicle.home is None:
            return None
        return dialect.MAVLink_home_position_message(
            vehicle.home.lat_e7,
            vehicle.home.lon_e7,
            round(vehicle.home.alt_amsl_m * 1000),
            *vehicle.origin.ned_to(vehicle.home),
            [nan, nan, nan, nan],
            0.0,
            0.0,
            0.0,
            vehicle.sim_time_ns // 1000,
        )

    def gps_global_origin(self) -> Message | None:
        """GPS_GLOBAL_ORIGIN, once there is an estimate."""
        if not self._estimate:
            return None
        origin = self._vehicle.origin
        return dialect.MAVLink_gps_global_origin_message(
            origin.lat_e7, origin.lon_e7, round(origin.alt_amsl_m * 1000), self._vehicle.sim_time_ns // 1000
        )

    def extended_sys_state(self) -> Message:
        """EXTENDED_SYS_STATE: on the ground, in the air, or between."""
        vehicle = self._vehicle
        if vehicle.landed:
            state = dialect.MAV_LANDED_STATE_ON_GROUND
        elif vehicle.taking_off:
            state = dialect.MAV_LANDED_STATE_TAKEOFF
        elif vehicle.landing:
            state = dialect.MAV_LANDED_STATE_LANDING
        else:
            state = dialect.MAV_LANDED_STATE_IN_AIR
        return dialect.MAVLink_extended_sys_state_message(dialect.MAV_VTOL_STATE_MC, state)

    def _rates(self) -> tuple[float, float, float]:
        return self._vehicle.frame.gyro_radps if self._vehicle.frame else (0.0, 0.0, 0.0)


def _course_rad(north: float, east: float) -> float:
    return atan2(east, north)


def _wanted_deg(vehicle: Vehicle) -> tuple[float, float, float]:
    roll, pitch, yaw = euler_from_quaternion(vehicle.controller.target)
    return degrees(roll), degrees(pitch), degrees(yaw)


def _int16(value: float) -> int:
    return max(-32768, min(32767, round(value)))
