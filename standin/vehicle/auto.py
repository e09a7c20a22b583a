"""AUTO: fly the mission's items one after the other."""

from __future__ import annotations

from typing import TYPE_CHECKING

from standin.vehicle.events import ItemReached, Severity
from standin.vehicle.location import Location
from standin.vehicle.maneuvers import Drive, ReturnSequence, Takeoff, land
from standin.vehicle.mission import SPEED_KINDS, Command, SpeedKind, StandinItem
from standin.vehicle.modes import FlightMode, ModeNumber

if TYPE_CHECKING:
    from standin.vehicle.vehicle import StandinVehicle

HEIGHT_REACHED_M = 1.0
TAKEOFF_RISE_MIN_M = 1.0
"""Of a takeoff from the ground (``ModeAuto::takeoff_start``)."""


class Auto(FlightMode):
    """Runs the mission from its current item."""

    number = ModeNumber.AUTO
    armable = False
    needs_mission = True

    def __init__(self) -> None:
        self._started = self._begun = False
        self._item: StandinItem | None = None
        self._revision = 0
        self._held_s = 0.0
        self._arrived = False
        self._takeoff: Takeoff | None = None
        self._return: ReturnSequence | None = None

    def refusal(self, vehicle: StandinVehicle) -> str:
        """Besides what all modes ask for: a mission that leaves the ground."""
        refusal = super().refusal(vehicle)
        mission = vehicle.mission
        first = mission.next_flown(max(mission.current, 1))
        if not refusal and vehicle.landed and (first is None or first.command != Command.TAKEOFF):
            vehicle.say(Severity.CRITICAL, "Auto: Missing Takeoff Cmd")
            refusal = "init failed"
        return refusal

    def enter(self, vehicle: StandinVehicle) -> None:
        """Be at the item where the mission was stopped, or at the first."""
        self._started = self._begun = False
        self._item = None
        vehicle.mission.begin()

    def start(self, vehicle: StandinVehicle) -> None:
        """Leave the ground, for which MAV_CMD_MISSION_START is waited; a mission that is complete begins anew."""
        if not vehicle.mission.running:
            self.enter(vehicle)
        self._started = True

    def update(self, vehicle: StandinVehicle, step_s: float) -> None:
        """Go on with the item."""
        mission = vehicle.mission
        if vehicle.landed and not self._started:
            vehicle.drive = Drive.IDLE
            return
        if mission.running and (mission.jumped or not self._begun):
            self._started, self._begun, mission.jumped = True, True, False
            self._start_item(vehicle, mission.current)
        elif self._revision != mission.revision:
            self._take_changed(vehicle)
        self._revision = mission.revision
        item = self._item
        if item is not None and self._fly(vehicle, item, step_s):
            self._start_item(vehicle, item.seq + 1, item)

    def touched_ground(self, vehicle: StandinVehicle) -> None:
        """Disarm after LAND, of which ArduCopter does not say that it is reached; after RTL, if that was all."""
        item = self._item
        if item is not None and item.command == Command.LAND:
            vehicle.disarm(force=False)
        elif item is not None and item.command == Command.RETURN_TO_LAUNCH:
            self._start_item(vehicle, item.seq + 1, item)

    def _take_changed(self, vehicle: StandinVehicle) -> None:
        """Fly to the place that an item has in a mission that was uploaded meanwhile."""
        item = self._item
        new = None if item is None else vehicle.mission.item(item.seq)
        if (
            item is None
            or new is None
            or new == item
            or item.command not in (Command.WAYPOINT, Command.LOITER_TIME)
        ):
            return
        self._start_item(vehicle, item.seq)
        vehicle.say(Severity.CRITICAL, "Auto mission changed, restarted command")

    def _start_item(self, vehicle: StandinVehicle, seq: int, reached: StandinItem | None = None) -> None:
        """Begin the next item that is flown, after those before it that only set something.

        ArduCopter says once in a while which was reached last: of an item and a setting after it, the setting. Of
        settings at the end of a mission it runs the first alone, and says of none that it was reached.
        """
        item = vehicle.mission.next_flown(seq)
        settings = [vehicle.mission.item(number) for number in range(seq, item.seq if item else seq + 1)]
        if reached is not None and (item is None or not settings):
            vehicle.tell(ItemReached(reached.seq))
        if reached is not None and reached.command in (Command.WAYPOINT, Command.LOITER_TIME):
            vehicle.say(Severity.INFO, f"Reached command #{reached.seq}")
        for setting in settings:
            if setting is not None:
                self._set(vehicle, setting)
                if item is not None:
                    vehicle.tell(ItemReached(setting.seq))
        if item is None:
            self._end(vehicle)
        else:
            vehicle.mission.current = item.seq
            vehicle.say(Severity.INFO, f"Mission: {item.seq} {_NAMES[item.command]}")
            self._begin(vehicle, item)

    @staticmethod
    def _set(vehicle: StandinVehicle, item: StandinItem) -> None:
        vehicle.say(Severity.INFO, f"Mission: {item.seq} {_NAMES[item.command]}")
        if item.param2 > 0 and item.param1 in SPEED_KINDS:
            vehicle.change_speed(SpeedKind(int(item.param1)), item.param2)

    def _end(self, vehicle: StandinVehicle) -> None:
        """The mission is complete: hold here (in the air), or disarm (on the ground)."""
        self._item = None
        vehicle.mission.end(complete=True)
        if vehicle.landed:
            vehicle.disarm(force=False)
        else:
            vehicle.navigator.stop()

    def _begin(self, vehicle: StandinVehicle, item: StandinItem) -> None:
        # As ArduCopter: from a point that is reached on, not from where the vehicle happens to be near it.
        present = vehicle.navigator.target_ned_m() if self._arrived else vehicle.position_ned_m
        self._item = item
        self._held_s = 0.0
        self._arrived = False
        self._takeoff = self._return = None
        if item.command == Command.TAKEOFF:
            down_m = vehicle.depth_of(item.alt_amsl_m(vehicle.home_or_origin))
            if vehicle.landed:
                down_m = min(down_m, vehicle.position_ned_m[2] - TAKEOFF_RISE_MIN_M)
            self._takeoff = Takeoff(vehicle, down_m)
        elif not vehicle.landed:  # nothing but a takeoff leaves the ground
            vehicle.drive = Drive.FOLLOW
            if item.command == Command.RETURN_TO_LAUNCH:
                vehicle.navigator.stop()
                self._return = ReturnSequence(vehicle)
            else:
                self._aim(vehicle, item, vehicle.origin.offset(*present))

    def _aim(self, vehicle: StandinVehicle, item: StandinItem, present: Location) -> None:
        level = item.command == Command.LAND
        if level and item.is_here:
            vehicle.navigator.stop()
            self._arrived = True
            return
        north_m, east_m, down_m = vehicle.origin.ned_to(item.location(vehicle.home_or_origin, present))
        vehicle.navigator.go_to(north_m, east_m)
        vehicle.navigator.go_to_depth(vehicle.position_ned_m[2] if level else down_m)
        if vehicle.parameters["WP_YAW_BEHAVIOR"] != 0:
            vehicle.navigator.look_ahead()

    def _fly(self, vehicle: StandinVehicle, item: StandinItem, step_s: float) -> bool:
        """Return whether the item is done."""
        if self._takeoff is not None:
            return self._takeoff.update(vehicle, step_s)
        if vehicle.landed:
            vehicle.drive = Drive.IDLE
        elif self._return is not None:
            self._return.update(vehicle, step_s)
        else:
            return self._go_there(vehicle, item, step_s)
        return False

    def _go_there(self, vehicle: StandinVehicle, item: StandinItem, step_s: float) -> bool:
        """Fly to the item's point, and land or wait there."""
        vehicle.drive = Drive.FOLLOW
        self._arrived = self._arrived or self._near(vehicle)
        if not self._arrived:
            return False
        if item.command == Command.LAND:
            land(vehicle)
            return False
        self._held_s += step_s
        return self._held_s >= item.param1

    def _near(self, vehicle: StandinVehicle) -> bool:
        radius_m = max(vehicle.parameters["WPNAV_RADIUS"] / 100, 0.1)
        height_off_m = abs(vehicle.position_ned_m[2] - vehicle.navigator.target_ned_m()[2])
        return vehicle.navigator.distance_m(vehicle.frame) < radius_m and height_off_m < HEIGHT_REACHED_M


_NAMES: dict[int, str] = {
    Command.WAYPOINT: "WP",
    Command.LOITER_TIME: "LoitTime",
    Command.RETURN_TO_LAUNCH: "RTL",
    Command.LAND: "Land",
    Command.TAKEOFF: "Takeoff",
    Command.DO_CHANGE_SPEED: "ChangeSpeed",
}
"""ArduPilot's short names of the commands."""
