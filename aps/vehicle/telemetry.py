"""State of one UA from its autopilot's telemetry (Table I of the paper), without I/O and clocks.

``Telemetry.update`` decodes the few message types that feed the state straight from the frame's bytes;
``Telemetry.state`` makes the frozen record. Units are in the names; what has not been heard yet is NaN,
``None`` or False.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from functools import lru_cache
from typing import Any, Final

from aps.timeouts import REBOOT_STEP_MS
from aps.vehicle.autopilots.choice import autopilot_of
from aps.vehicle.state import FLYING, NAN, NO_VECTOR, NS_PER_S, LandedState, Vector3, VehicleState
from aps.wire.dialect import enum_label, mavlink
from aps.wire.framer import Frame

__all__ = ["LandedState", "Telemetry", "Vector3", "VehicleState"]


CLOCK_WRAP_MS: Final = 1 << 32
WRAP_WINDOW_MS: Final = 600_000
"""A clock that falls from within this of its end to within this of 0 has wrapped; any other fall is a reboot."""
BOOT_SHIFT_MS: Final = 5000
"""After a new connection: UTC less the autopilot's clock differing by more than this is another boot."""

_LANDED: Final = ("undefined", "on_ground", "in_air", "takeoff", "landing")

_HEARTBEAT: Final = 0
_IN_HEARTBEAT: Final = ("vehicle_type", "autopilot", "mode", "base_mode", "armed", "system_status")
CLOCKS: Final = {2: 8, 30: 0, 32: 0, 33: 0}
"""Ids of the messages that carry the autopilot's clock, and where in their payloads."""
NS_PER_MS: Final = 1_000_000

_ARMED: Final = int(mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
_EKF_POSITION: Final = int(mavlink.ESTIMATOR_POS_HORIZ_ABS)


@lru_cache(maxsize=256)
def _mode_name(vehicle_type: int, autopilot: int, custom_mode: int) -> str:
    names = {number: name for name, number in autopilot_of(autopilot).modes(vehicle_type).items()}
    return names.get(custom_mode, f"MODE_{custom_mode}")


@lru_cache(maxsize=256)
def _base_mode_label(base_mode: int) -> str:
    return "|".join(enum_label("MAV_MODE_FLAG", 1 << bit) for bit in range(8) if base_mode & 1 << bit)


class Telemetry:
    """Collects one autopilot's telemetry. Feed it frames of that autopilot only."""

    def __init__(self, sysid: int) -> None:
        self.sysid = sysid
        self.reboots = 0
        """How often the autopilot's clock has gone back."""
        self.custom_mode = 0
        """Of the newest heartbeat: the mode as the autopilot numbers it."""
        self.decode_errors = 0
        """Frames of a known type whose values made no sense: a latitude of 300 degrees, an infinite number. NaN is
        no error: autopilots send it for what they do not know."""
        self._values: dict[str, Any] = {"sysid": sysid}
        self._heartbeat_ns: int | None = None
        self._armed_and_up = False
        self._flight_start_ms = 0
        self._flight_ms = 0
        self._has_local = False
        self._landed_known = False
        self._heard_ns: dict[int, int] = {}
        self._unix_at_boot_ms = 0
        self._new_link = False
        self._link_open = True
        self._told: VehicleState | None = None
        """The state as last asked for, until something changes it."""
        self._now_ns = 0
        self._wraps_ms = 0
        """What the autopilot's clock of 32 bits has lost by starting anew from 0, every 49.7 days."""

    @property
    def clock_ms(self) -> int:
        """The autopilot's clock, from its newest message."""
        clock_ms: int = self._values.get("time_boot_ms", 0)
        return clock_ms

    @property
    def vehicle_type(self) -> int:
        """MAV_TYPE of the autopilot's newest heartbeat; 0 before the first one of its boot."""
        vehicle_type: int = self._values.get("vehicle_type", 0)
        return vehicle_type

    @property
    def autopilot(self) -> int:
        """MAV_AUTOPILOT of its newest heartbeat."""
        autopilot: int = self._values.get("autopilot", 0)
        return autopilot

    @property
    def mode(self) -> str:
        """The autopilot's flight mode, from its newest heartbeat."""
        mode: str = self._values.get("mode", "")
        return mode

    @property
    def armed(self) -> bool:
        """Whether it is armed, by its newest heartbeat."""
        return bool(self._values.get("armed"))

    def state(self, now_ns: int) -> VehicleState:
        """The state as known at ``now_ns`` (same monotonic clock as ``update``)."""
        if self._told is not None and self._told.as_of_ns == now_ns:
            return self._told
        age_s = math.inf if self._heartbeat_ns is None else (now_ns - self._heartbeat_ns) / NS_PER_S
        self._told = VehicleState(
            **self._values,
            as_of_ns=now_ns,
            heard_ns=dict(self._heard_ns),
            heartbeat_age_s=age_s,
            link_open=self._link_open,
            airspeed_mps=self._airspeed_mps(),
            flight_time_s=self._flight_ms / 1000.0,
        )
        return self._told

    def update(self, frame: Frame, now_ns: int) -> bool:
        """Take one frame; returns whether it was of a type that feeds the state."""
        raw, msg_id, _, _, _, _, start, length = frame
        decoder = _DECODERS.get(msg_id)
        if decoder is None:
            return False
        layout, size, handler, has_floats = decoder
        if length >= size:
            fields = layout.unpack_from(raw, start)
        else:
            fields = layout.unpack(raw[start : start + length].ljust(size, b"\0"))
        if has_floats and (math.inf in fields or -math.inf in fields):
            self.decode_errors += 1
            return True
        self._now_ns, self._told = now_ns, None
        if msg_id == 0:
            self._heartbeat_ns = now_ns
        errors = self.decode_errors
        handler(self, fields)
        if self.decode_errors == errors:
            self._heard_ns[msg_id] = now_ns
        return True

    def forget(self) -> None:
        """Forget everything (a new boot of the autopilot): nothing of the old boot is shown as current."""
        self._values, self._told = {"sysid": self.sysid}, None
        self._heard_ns.clear()
        self._armed_and_up = self._has_local = self._landed_known = False
        self._flight_ms = 0
        self._unix_at_boot_ms = 0

    def link_up(self) -> None:
        """There is a new connection: another boot of the autopilot may be at its end, also one that is older."""
        self._new_link = self._link_open = True
        self._told = None

    def link_down(self) -> None:
        """No link leads to the autopilot any more."""
        self._link_open, self._told = False, None

    def _rebooted(self, time_boot_ms: int) -> None:
        """Forget all but a heartbeat that the new boot has sent before this, its first message with a clock."""
        self.reboots += 1
        told, heard_ns = self._values, self._heard_ns.get(_HEARTBEAT)
        clock_ns = max(self._heard_ns.get(msg_id, -1) for msg_id in CLOCKS)
        self.forget()
        if heard_ns is not None and heard_ns > max(clock_ns, self._now_ns - time_boot_ms * NS_PER_MS):
            self._values.update((name, told[name]) for name in _IN_HEARTBEAT)
            self._heard_ns[_HEARTBEAT] = heard_ns

    # One method per message type; ``fields`` in wire order.

    def _heartbeat(self, fields: tuple[Any, ...]) -> None:
        custom_mode, vehicle_type, autopilot, base_mode, system_status = fields
        self.custom_mode = custom_mode
        values = self._values
        values["vehicle_type"], values["autopilot"] = vehicle_type, autopilot
        values["mode"] = _mode_name(vehicle_type, autopilot, custom_mode)
        values["base_mode"] = _base_mode_label(base_mode)
        values["armed"] = armed = bool(base_mode & _ARMED)
        values["system_status"] = enum_label("MAV_STATE", system_status)
        if not armed and values.get("landed_state") in FLYING:
            values["landed_state"] = "undefined"  # that was said before
        if not self._landed_known:
            self._set_airborne(armed and self._values.get("alt_rel_m", 0.0) > 1.0)
        elif not armed:
            self._set_airborne(False)

    def _sys_status(self, fields: tuple[Any, ...]) -> None:
        _, enabled, health, _, voltage_mv, current_ca, _, _, _, _, _, _, remaining = fields
        values = self._values
        values["ready_to_arm"] = autopilot_of(self.autopilot).ready_to_arm(enabled, health)
        values["voltage_v"] = NAN if voltage_mv in (0, 0xFFFF) else voltage_mv / 1000.0
        values["current_a"] = NAN if current_ca < 0 else current_ca / 100.0
        values["battery_remaining_percent"] = NAN if remaining < 0 else float(remaining)

    def _system_time(self, fields: tuple[Any, ...]) -> None:
        unix_us, time_boot_ms = fields
        at_boot_ms = unix_us // 1000 - time_boot_ms if unix_us else 0
        known_ms = self._unix_at_boot_ms
        if self._new_link and at_boot_ms and known_ms and abs(at_boot_ms - known_ms) > BOOT_SHIFT_MS:
            self._rebooted(time_boot_ms)
        self._new_link = self._new_link and not at_boot_ms
        self._unix_at_boot_ms = at_boot_ms or self._unix_at_boot_ms
        self._clock(time_boot_ms)

    def _gps_raw_int(self, fields: tuple[Any, ...]) -> None:
        self._values["gps_fix_type"] = fields[8]
        self._values["satellites_visible"] = 0 if fields[9] == 0xFF else fields[9]

    def _attitude(self, fields: tuple[Any, ...]) -> None:
        self._clock(fields[0])
        values = self._values
        _, values["roll_rad"], values["pitch_rad"], values["yaw_rad"], _, _, _ = fields

    def _local_position_ned(self, fields: tuple[Any, ...]) -> None:
        self._clock(fields[0])
        self._has_local = True
        self._values["position_ned_m"] = fields[1:4]
        self._values["velocity_ned_mps"] = fields[4:7]

    def _global_position_int(self, fields: tuple[Any, ...]) -> None:
        time_boot_ms, lat, lon, alt_mm, alt_rel_mm, north_cmps, east_cmps, down_cmps, _ = fields
        self._clock(time_boot_ms)
        if not self._on_earth(lat, lon):
            return
        values = self._values
        is_known = "lat_deg" in values or "home_lat_deg" in values or values.get("position_ok", False)
        is_guess = autopilot_of(self.autopilot).is_guess(lat, lon, alt_mm, alt_rel_mm)
        if is_known or ((lat or lon) and not is_guess):
            values["lat_deg"], values["lon_deg"] = lat * 1e-7, lon * 1e-7
            values["alt_amsl_m"], values["alt_rel_m"] = alt_mm * 1e-3, alt_rel_mm * 1e-3
        if not self._has_local:
            values["velocity_ned_mps"] = (north_cmps * 0.01, east_cmps * 0.01, down_cmps * 0.01)

    def _mission_current(self, fields: tuple[Any, ...]) -> None:
        seq, total, state, _ = fields
        self._values["mission_current"] = seq
        known = autopilot_of(self.autopilot)
        self._values["mission_total"] = known.last_item(total, state)
        self._values["mission_state"] = enum_label("MISSION_STATE", state) if state else ""

    def _mission_item_reached(self, fields: tuple[Any, ...]) -> None:
        self._values["mission_reached"] = fields[0]

    def _nav_controller_output(self, fields: tuple[Any, ...]) -> None:
        self._values["waypoint_distance_m"] = float(fields[7])

    def _vfr_hud(self, fields: tuple[Any, ...]) -> None:
        values = self._values
        values["indicated_airspeed_mps"], values["groundspeed_mps"] = fields[0], fields[1]
        values["climb_mps"], values["throttle_percent"] = fields[3], float(fields[5])

    def _battery_status(self, fields: tuple[Any, ...]) -> None:
        # Of battery 0 only; SYS_STATUS has its voltage and a coarser current.
        if fields[14] == 0 and fields[13] >= 0:
            self._values["current_a"] = fields[13] / 100.0

    def _wind(self, fields: tuple[Any, ...]) -> None:
        # ArduPilot: direction the wind comes FROM in degrees, length of the 3-D vector, down component.
        direction_deg, speed_mps, down_mps = fields
        horizontal_mps = math.sqrt(max(0.0, speed_mps * speed_mps - down_mps * down_mps))
        direction_rad = math.radians(direction_deg)
        self._values["wind_ned_mps"] = (
            -horizontal_mps * math.cos(direction_rad),
            -horizontal_mps * math.sin(direction_rad),
            down_mps,
        )

    def _wind_cov(self, fields: tuple[Any, ...]) -> None:
        self._values["wind_ned_mps"] = fields[1:4]

    def _estimator_status(self, fields: tuple[Any, ...]) -> None:
        self._values["position_ok"] = bool(fields[1] & _EKF_POSITION)

    def _ekf_status(self, fields: tuple[Any, ...]) -> None:
        self._values["position_ok"] = bool(fields[5] & _EKF_POSITION)

    def _on_earth(self, lat: int, lon: int) -> bool:
        """Whether a position in 1e-7 degrees is one; counted if not."""
        good = abs(lat) <= 900_000_000 and abs(lon) <= 1_800_000_000
        self.decode_errors += not good
        return good

    def _home_position(self, fields: tuple[Any, ...]) -> None:
        if not self._on_earth(fields[0], fields[1]):
            return
        values = self._values
        values["home_lat_deg"], values["home_lon_deg"] = fields[0] * 1e-7, fields[1] * 1e-7
        values["home_alt_amsl_m"] = fields[2] * 1e-3

    def _extended_sys_state(self, fields: tuple[Any, ...]) -> None:
        landed = _LANDED[fields[1]] if fields[1] < len(_LANDED) else "undefined"
        self._values["landed_state"], self._values["vtol"] = landed, bool(fields[0])
        if landed != "undefined":
            self._landed_known = True
            self._set_airborne(landed != "on_ground" and self._values.get("armed", False))

    def _clock(self, time_boot_ms: int) -> None:
        known_ms = self._values.get("time_boot_ms", 0)
        time_boot_ms += self._wraps_ms
        if not 0 <= time_boot_ms - known_ms < WRAP_WINDOW_MS:
            jumped_ms = self._jumped(time_boot_ms, known_ms)
            if jumped_ms is None:
                return
            time_boot_ms = jumped_ms
        self._values["time_boot_ms"] = time_boot_ms
        if self._armed_and_up:
            self._flight_ms = time_boot_ms - self._flight_start_ms

    def _jumped(self, time_boot_ms: int, known_ms: int) -> int | None:
        """A clock that went back or far ahead: the time it is; ``None`` for one that is late."""
        if known_ms - time_boot_ms > CLOCK_WRAP_MS - WRAP_WINDOW_MS:
            self._wraps_ms += CLOCK_WRAP_MS
            time_boot_ms += CLOCK_WRAP_MS
        elif time_boot_ms - known_ms > CLOCK_WRAP_MS - WRAP_WINDOW_MS and self._wraps_ms:
            return None  # late, from before the clock began anew
        if time_boot_ms < known_ms - REBOOT_STEP_MS:
            time_boot_ms -= self._wraps_ms
            self._rebooted(time_boot_ms)
            self._wraps_ms = 0
        elif time_boot_ms < known_ms:
            return None
        return time_boot_ms

    def _set_airborne(self, airborne: bool) -> None:
        if airborne and not self._armed_and_up:
            self._flight_start_ms = self._values.get("time_boot_ms", 0)
            self._flight_ms = 0
        self._armed_and_up = airborne

    def _airspeed_mps(self) -> float:
        velocity: Vector3 = self._values.get("velocity_ned_mps", NO_VECTOR)
        wind: Vector3 = self._values.get("wind_ned_mps", NO_VECTOR)
        airspeed_mps = math.dist(velocity, wind)
        if math.isnan(airspeed_mps):
            airspeed_mps = self._values.get("indicated_airspeed_mps", NAN)
        return airspeed_mps


_Handler = Callable[[Telemetry, tuple[Any, ...]], None]
_DECODERS: Final[dict[int, tuple[struct.Struct, int, _Handler, bool]]] = {
    msg_id: (struct.Struct(layout), struct.calcsize(layout), handler, "f" in layout)
    for msg_id, layout, handler in (
        # The leading fields that we use, in wire order (common.xml, ardupilotmega.xml).
        (0, "<IBBBB", Telemetry._heartbeat),
        (1, "<IIIHHhHHHHHHb", Telemetry._sys_status),
        (2, "<QI", Telemetry._system_time),
        (24, "<QiiiHHHHBB", Telemetry._gps_raw_int),
        (30, "<Iffffff", Telemetry._attitude),
        (32, "<Iffffff", Telemetry._local_position_ned),
        (33, "<IiiiihhhH", Telemetry._global_position_int),
        (42, "<HHBB", Telemetry._mission_current),
        (46, "<H", Telemetry._mission_item_reached),
        (62, "<fffffhhH", Telemetry._nav_controller_output),
        (74, "<ffffhH", Telemetry._vfr_hud),
        (147, "<iih10HhBBBb", Telemetry._battery_status),
        (168, "<fff", Telemetry._wind),
        (193, "<fffffH", Telemetry._ekf_status),
        (230, "<Q32xH", Telemetry._estimator_status),
        (231, "<Qfff", Telemetry._wind_cov),
        (242, "<iii", Telemetry._home_position),
        (245, "<BB", Telemetry._extended_sys_state),
    )
}
"""Message id -> (layout, its bytes, handler, whether it has floats) of everything that feeds the state."""
