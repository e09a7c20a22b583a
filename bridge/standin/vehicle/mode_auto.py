"""AUTO: fly the mission's items one after the other."""

from __future__ import annotations

from math import radians
from typing import TYPE_CHECKING

from bridge.standin.vehicle.events import ItemReached, Severity
from bridge.standin.vehicle.flight_modes import FlightMode, ModeNumber
from bridge.standin.vehicle.maneuvers import Drive, Landing, ReturnSequence, Takeoff
from bridge.standin.vehicle.mission import NAVIGATION_COMMANDS, Command, MissionItem

if TYPE_CHECKING:
    from bridge.standin.vehicle.vehicle import Vehicle

HEIGHT_REACHED_M = 1.0
REPORTED_COMMANDS = frozenset({Command.WAYPOINT, Command.LOITER_TIME})
DO_ITEMS_IN_A_ROW_MAX = 100
"""More DO items without a NAV item between them are a loop (DO_JUMP)."""


class Auto(FlightMode):
    """Runs the mission from its current item."""

    number = ModeNumber.AUTO
    armable = False
    needs_mission = True

    def __init__(self) -> None:
        self.started = False
        """A vehicle on the ground waits for MAV_CMD_MISSION_START (or a raised throttle)."""
        self._item: MissionItem | None = None
        self._revision = -1
        self._held_s = 0.0
        self._arrived = False
        self._takeoff: Takeoff | None = None
        self._landing: Landing | None = None
        self._return: ReturnSequence | None = None
        self._jumps: dict[int, int] = {}

    def refusal(self, vehicle: Vehicle) -> str:
        """AUTO needs a mission."""
        return super().refusal(vehicle) or ("" if len(vehicle.mission) > 1 else "no mission")

    def update(self, vehicle: Vehicle, step_s: float) -> None:
        """Go on with the item."""
        if vehicle.landed and not self.started:
            sticks = vehicle.rc.sticks(vehicle.sim_time_ns)
            self.started = sticks is not None and sticks.throttle > 0.1
            vehicle.drive = Drive.IDLE
            return
        self.started = True
        if self._revision != vehicle.mission.revision:
            self._revision = vehicle.mission.revision
            self._start_item(vehicle, max(vehicle.mission.current, 1))
        item = self._item
        if item is not None and self._fly(vehicle, item, step_s):
            self._tell_reached(vehicle, item)
            self._start_item(vehicle, item.seq + 1)

    def touched_ground(self, vehicle: Vehicle) -> None:
        """Disarm after a landing that the mission asked for."""
        if self._landing is not None or self._return is not None:
            self._finish_landing(vehicle)

    def _tell_reached(self, vehicle: Vehicle, item: MissionItem) -> None:
        vehicle.tell(ItemReached(item.seq))
        if item.command in REPORTED_COMMANDS:
            vehicle.say(Severity.INFO, f"Reached command #{item.seq}")

    def _finish_landing(self, vehicle: Vehicle) -> None:
        if self._item is not None:
            self._tell_reached(vehicle, self._item)
        self._item = None
        vehicle.disarm(force=False)

    # --- items

    def _start_item(self, vehicle: Vehicle, seq: int) -> None:
        """Run DO items from ``seq`` on until an item that must be flown."""
        for _ in range(DO_ITEMS_IN_A_ROW_MAX):
            item = vehicle.mission.item(seq)
            if item is None:
                self._end(vehicle)
                return
            vehicle.mission.current = seq
            vehicle.say(Severity.INFO, f"Mission: {seq} {_NAMES[item.command]}")
            if item.command in NAVIGATION_COMMANDS or item.command == Command.CONDITION_DELAY:
                self._begin(vehicle, item)
                return
            seq = self._do(vehicle, item)
        vehicle.say(Severity.ERROR, "Mission: DO_JUMP loop")
        self._end(vehicle)

    def _end(self, vehicle: Vehicle) -> None:
        """The mission is complete: hold here (in the air), or disarm (on the ground)."""
        self._item = None
        if vehicle.landed:
            vehicle.disarm(force=False)
        else:
            vehicle.navigator.stop()

    def _begin(self, vehicle: Vehicle, item: MissionItem) -> None:
        self._item = item
        self._held_s = 0.0
        self._arrived = False
        self._takeoff = self._landing = self._return = None
        if vehicle.landed and item.command != Command.TAKEOFF:
            return  # nothing but a takeoff leaves the ground
        if item.command == Command.TAKEOFF:
            alt_amsl_m = item.location(vehicle.home_or_origin, vehicle.location).alt_amsl_m
            self._takeoff = Takeoff(vehicle, vehicle.depth_of(alt_amsl_m))
        elif item.command == Command.RETURN_TO_LAUNCH:
            self._return = ReturnSequence()
            vehicle.navigator.stop()
            self._return.start(vehicle)
        elif item.command not in (Command.DELAY, Command.CONDITION_DELAY):
            self._aim(vehicle, item)

    def _aim(self, vehicle: Vehicle, item: MissionItem) -> None:
        vehicle.drive = Drive.FOLLOW
        location = item.location(vehicle.home_or_origin, vehicle.location)
        north_m, east_m, down_m = vehicle.origin.ned_to(location)
        vehicle.navigator.go_to(north_m, east_m)
        if item.command != Command.LAND:
            vehicle.navigator.go_to_depth(down_m)
        else:
            vehicle.navigator.go_to_depth(vehicle.position_ned_m[2])
        if vehicle.parameters["WP_YAW_BEHAVIOR"] != 0:
            vehicle.navigator.look_ahead()

    def _fly(self, vehicle: Vehicle, item: MissionItem, step_s: float) -> bool:
        """Return whether the item is done."""
        if vehicle.landed and self._takeoff is None:
            vehicle.drive = Drive.IDLE
            return False
        vehicle.drive = Drive.FOLLOW if self._takeoff is None else vehicle.drive
        command = item.command
        if self._takeoff is not None:
            return self._takeoff.update(vehicle, step_s)
        if self._return is not None:
            self._return.update(vehicle, step_s)
            return False
        if command == Command.LAND:
            self._land(vehicle)
            return False
        if command in (Command.DELAY, Command.CONDITION_DELAY):
            self._held_s += step_s
            return self._held_s >= item.param1
        return self._hold_at_point(vehicle, item, step_s)

    def _land(self, vehicle: Vehicle) -> None:
        """Fly over the point, then come down."""
        if self._landing is None and self._near(vehicle):
            self._landing = Landing()
        if self._landing is not None:
            self._landing.update(vehicle)

    def _hold_at_point(self, vehicle: Vehicle, item: MissionItem, step_s: float) -> bool:
        self._arrived = self._arrived or self._near(vehicle)
        if not self._arrived or item.command == Command.LOITER_UNLIMITED:
            return False
        self._held_s += step_s
        return self._held_s >= item.param1

    def _near(self, vehicle: Vehicle) -> bool:
        if vehicle.frame is None:
            return False
        radius_m = max(vehicle.parameters["WPNAV_RADIUS"] / 100, 0.1)
        height_off_m = abs(vehicle.position_ned_m[2] - vehicle.navigator.target_ned_m()[2])
        return vehicle.navigator.distance_m(vehicle.frame) < radius_m and height_off_m < HEIGHT_REACHED_M

    def _do(self, vehicle: Vehicle, item: MissionItem) -> int:
        """Run an item that takes no time; return the number of the next."""
        if item.command == Command.DO_JUMP:
            done = self._jumps.get(item.seq, 0)
            if item.param2 < 0 or done < item.param2:
                self._jumps[item.seq] = done + 1
                return int(item.param1)
        elif item.command == Command.DO_CHANGE_SPEED and item.param2 > 0:
            vehicle.speed_override_mps = item.param2
        elif item.command == Command.CONDITION_YAW:
            turn_to_condition(vehicle, item.param1, item.param3, relative=item.param4 > 0)
        return item.seq + 1


def turn_to_condition(vehicle: Vehicle, angle_deg: float, direction: float, *, relative: bool) -> None:
    """Turn as MAV_CMD_CONDITION_YAW says: to a heading, or by an angle in a direction (-1 left, 1 right)."""
    if relative:
        sign = -1.0 if direction < 0 else 1.0
        vehicle.navigator.turn_to(vehicle.navigator.yaw_rad + sign * radians(angle_deg))
    else:
        vehicle.navigator.turn_to(radians(angle_deg))


_NAMES: dict[int, str] = {
    Command.WAYPOINT: "WP",
    Command.LOITER_UNLIMITED: "LoitUnlim",
    Command.LOITER_TIME: "LoitTime",
    Command.RETURN_TO_LAUNCH: "RTL",
    Command.LAND: "Land",
    Command.TAKEOFF: "Takeoff",
    Command.DELAY: "Delay",
    Command.CONDITION_DELAY: "CondDelay",
    Command.CONDITION_YAW: "CondYaw",
    Command.DO_JUMP: "Jump",
    Command.DO_CHANGE_SPEED: "ChangeSpeed",
}
"""ArduPilot's short names of the commands."""
