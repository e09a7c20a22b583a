"""Builders of the messages that can be streamed or requested: the vehicle's state in MAVLink's units."""

from __future__ import annotations

from collections.abc import Callable
from math import atan2, degrees, hypot, nan

from pymavlink.dialects.v20 import ardupilotmega as dialect

from standin.control.quaternion import euler_from_quaternion
from standin.vehicle.location import Location
from standin.vehicle.vehicle import ESTIMATE_AFTER_S, GPS_FIX_AFTER_S, StandinVehicle, heading_deg
from standin.wire.mavlink_codec import Message

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
BASE_MODE = (
    dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
    | dialect.MAV_MODE_FLAG_STABILIZE_ENABLED
    | dialect.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED
)
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
    | dialect.MAV_PROTOCOL_CAPABILITY_MISSION_FENCE
    | dialect.MAV_PROTOCOL_CAPABILITY_MISSION_RALLY
    | dialect.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
    | dialect.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
    | dialect.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_GLOBAL_INT
    | dialect.MAV_PROTOCOL_CAPABILITY_MAVLINK2
    | dialect.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST
)
MAV_TYPES = {4: dialect.MAV_TYPE_QUADROTOR, 6: dialect.MAV_TYPE_HEXAROTOR}
"""By the number of motors."""
UNKNOWN_16 = 0xFFFF


class TelemetryProtocol:
    """Builds messages from a vehicle."""

    def __init__(self, vehicle: StandinVehicle, boot_unix_us: int) -> None:
        self._vehicle = vehicle
        self._boot_unix_us = boot_unix_us
        self.builders: dict[int, Callable[[], Message | None]] = {
            dialect.MAVLINK_MSG_ID_HEARTBEAT: self.heartbeat,
            dialect.MAVLINK_MSG_ID_SYS_STATUS: self.sys_status,
            dialect.MAVLINK_MSG_ID_SYSTEM_TIME: self.system_time,
            dialect.MAVLINK_MSG_ID_GPS_RAW_INT: self.gps_raw_int,
            dialect.MAVLINK_MSG_ID_ATTITUDE: self.attitude,
            dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED: self.local_position_ned,
            dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: self.global_position_int,
            dialect.MAVLINK_MSG_ID_MISSION_CURRENT: self.mission_current,
            dialect.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT: self.nav_controller_output,
            dialect.MAVLINK_MSG_ID_VFR_HUD: self.vfr_hud,
            dialect.MAVLINK_MSG_ID_BATTERY_STATUS: self.battery_status,
            dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION: self.autopilot_version,
            dialect.MAVLINK_MSG_ID_WIND: self.wind,
            dialect.MAVLINK_MSG_ID_EKF_STATUS_REPORT: self.ekf_status_report,
            dialect.MAVLINK_MSG_ID_HOME_POSITION: self.home_position,
            dialect.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: self.extended_sys_state,
        }
        """Per message id: returns the message, or None if there is nothing to say yet."""

    @property
    def _boot_ms(self) -> int:
        return (self._vehicle.sim_time_ns // 1_000_000) & 0xFFFFFFFF

    @property
    def _boot_us(self) -> int:
        return self._vehicle.sim_time_ns // 1000

    @property
    def _estimate(self) -> bool:
        return self._vehicle.uptime_s >= ESTIMATE_AFTER_S

    def heartbeat(self) -> Message:
        """HEARTBEAT: mode, arming, state."""
        vehicle = self._vehicle
        base_mode = BASE_MODE
        if vehicle.mode.guided_flag:
            base_mode |= dialect.MAV_MODE_FLAG_GUIDED_ENABLED
        if vehicle.armed:
            base_mode |= dialect.MAV_MODE_FLAG_SAFETY_ARMED
        state = dialect.MAV_STATE_STANDBY if vehicle.landed else dialect.MAV_STATE_ACTIVE
        kind, autopilot = MAV_TYPES[vehicle.motor_count], dialect.MAV_AUTOPILOT_ARDUPILOTMEGA
        return dialect.MAVLink_heartbeat_message(
            kind, autopilot, base_mode, int(vehicle.mode.number), state, 3
        )

    def sys_status(self) -> Message:
        """SYS_STATUS: sensors' health with the PREARM_CHECK bit, battery."""
        vehicle = self._vehicle
        health = SENSORS | dialect.MAV_SYS_STATUS_GEOFENCE  # there is none to be breached
        if not self._estimate:
            health &= ~dialect.MAV_SYS_STATUS_AHRS
        if vehicle.uptime_s < GPS_FIX_AFTER_S:
            health &= ~dialect.MAV_SYS_STATUS_SENSOR_GPS
        if vehicle.prearm_failures():
            health &= ~dialect.MAV_SYS_STATUS_PREARM_CHECK
        enabled = SENSORS if vehicle.armed else SENSORS & ~dialect.MAV_SYS_STATUS_SENSOR_MOTOR_OUTPUTS
        power = (self._millivolts(), round(vehicle.battery.current_a * 100), self._remaining_percent())
        return dialect.MAVLink_sys_status_message(SENSORS, enabled, health, 0, *power, *(0,) * 6)

    def system_time(self) -> Message:
        """SYSTEM_TIME."""
        return dialect.MAVLink_system_time_message(self._boot_unix_us + self._boot_us, self._boot_ms)

    def gps_raw_int(self) -> Message:
        """GPS_RAW_INT: RTK-fixed, as ArduPilot's simulated GPS says."""
        vehicle = self._vehicle
        north, east, _ = vehicle.velocity_ned_mps
        speed_cmps = min(round(hypot(north, east) * 100), UNKNOWN_16)
        course_deg = 0.0 if speed_cmps < 10 else heading_deg(atan2(east, north))
        fixed = vehicle.uptime_s >= GPS_FIX_AFTER_S
        fix, satellites = (dialect.GPS_FIX_TYPE_RTK_FIXED, SATELLITES) if fixed else (1, 0)
        place = _e7(vehicle.location if fixed else vehicle.origin)
        motion = (121, 200, speed_cmps, round(course_deg * 100) % 36000)
        return dialect.MAVLink_gps_raw_int_message(self._boot_us, fix, *place, *motion, satellites)

    def attitude(self) -> Message:
        """ATTITUDE."""
        vehicle = self._vehicle
        return dialect.MAVLink_attitude_message(
            self._boot_ms, *vehicle.attitude_rad, *vehicle.frame.gyro_radps
        )

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
        velocity = (_int16(speed_mps * 100) for speed_mps in vehicle.velocity_ned_mps)
        heading_cdeg = round(heading_deg(vehicle.attitude_rad[2]) * 100) % 36000
        height_mm = round(vehicle.alt_rel_m * 1000)
        return dialect.MAVLink_global_position_int_message(
            self._boot_ms, *_e7(vehicle.location), height_mm, *velocity, heading_cdeg
        )

    def mission_current(self) -> Message:
        """MISSION_CURRENT; its mode is 1 in AUTO, else 0, as ArduPilot's."""
        vehicle, mission = self._vehicle, self._vehicle.mission
        in_auto = vehicle.mode.name == "AUTO"
        if len(mission) < 2:
            state = dialect.MISSION_STATE_NO_MISSION
        elif mission.complete:
            state = dialect.MISSION_STATE_COMPLETE
        elif mission.running:
            state = dialect.MISSION_STATE_ACTIVE
        else:
            state = dialect.MISSION_STATE_NOT_STARTED  # also of one that was stopped, as ArduPilot
        total = max(len(mission) - 1, 0)
        return dialect.MAVLink_mission_current_message(mission.current, total, state, int(in_auto))

    def nav_controller_output(self) -> Message:
        """NAV_CONTROLLER_OUTPUT: attitude wanted, bearing and distance to the target."""
        vehicle = self._vehicle
        roll, pitch, yaw = (degrees(angle) for angle in euler_from_quaternion(vehicle.controller.target))
        bearing_deg = round(degrees(vehicle.navigator.bearing_rad(vehicle.frame)))
        distance_m = min(round(vehicle.navigator.distance_m(vehicle.frame)), UNKNOWN_16)
        climb_m = vehicle.position_ned_m[2] - vehicle.navigator.target_ned_m()[2] if vehicle.armed else 0.0
        return dialect.MAVLink_nav_controller_output_message(
            roll, pitch, round(yaw), bearing_deg, distance_m, climb_m, 0.0, 0.0
        )

    def vfr_hud(self) -> Message:
        """VFR_HUD: height above sea level, as ArduCopter sends."""
        vehicle = self._vehicle
        north, east, down = vehicle.velocity_ned_mps
        groundspeed_mps, airspeed_mps = hypot(north, east), vehicle.frame.airspeed_mps
        heading = round(heading_deg(vehicle.attitude_rad[2])) % 360
        throttle = round(100 * vehicle.controller.throttle) if vehicle.armed else 0
        return dialect.MAVLink_vfr_hud_message(
            groundspeed_mps if airspeed_mps is None else airspeed_mps,
            groundspeed_mps,
            heading,
            throttle,
            vehicle.location.alt_amsl_m,
            -down,
        )

    def battery_status(self) -> Message:
        """BATTERY_STATUS of the one battery."""
        battery = self._vehicle.battery
        voltages = [self._millivolts()] + [UNKNOWN_16] * 9
        use = (round(battery.current_a * 100), round(battery.used_mah), -1, self._remaining_percent())
        return dialect.MAVLink_battery_status_message(0, 0, 0, 32767, voltages, *use)

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
        north_mps, east_mps = self._vehicle.wind.north_mps, self._vehicle.wind.east_mps
        from_deg = degrees(atan2(-east_mps, -north_mps))
        return dialect.MAVLink_wind_message(from_deg, hypot(north_mps, east_mps), 0.0)

    def ekf_status_report(self) -> Message:
        """EKF_STATUS_REPORT: flags only, the stand-in has no filter."""
        flags = EKF_FLAGS_READY if self._estimate else dialect.EKF_UNINITIALIZED
        return dialect.MAVLink_ekf_status_report_message(flags, *(0.0,) * 5)

    def home_position(self) -> Message | None:
        """HOME_POSITION, once home is set."""
        home = self._vehicle.home
        if home is None:
            return None
        position = self._vehicle.origin.ned_to(home)
        return dialect.MAVLink_home_position_message(
            *_e7(home), *position, [nan] * 4, 0.0, 0.0, 0.0, self._boot_us
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

    def _millivolts(self) -> int:
        vehicle = self._vehicle
        return round(vehicle.battery.voltage_v(vehicle.parameters["BATT_CAPACITY"]) * 1000)

    def _remaining_percent(self) -> int:
        vehicle = self._vehicle
        return round(100 * vehicle.battery.remaining(vehicle.parameters["BATT_CAPACITY"]))


def _e7(place: Location) -> tuple[int, int, int]:
    """Return latitude and longitude in 1e-7 degrees and the height above sea level in mm."""
    return place.lat_e7, place.lon_e7, round(place.alt_amsl_m * 1000)


def _int16(value: float) -> int:
    return max(-32768, min(32767, round(value)))
