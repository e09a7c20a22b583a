"""AUTO: fly the mission's items one after the other."""

from __future__ import annotations

from standin.vehicle.events import ItemReached, Severity
from standin.vehicle.location import Location
from standin.vehicle.maneuvers import ReturnSequence, Takeoff, land
from standin.vehicle.mission import SPEED_KINDS, Command, SpeedKind, StandinItem
from standin.vehicle.mode import Drive, ModeNumber
from standin.vehicle.modes import VehicleMode
from standin.vehicle.vehicle import StandinVehicle

HEIGHT_REACHED_M = 1.0
TAKEOFF_RISE_MIN_M = 1.0
"""Of a takeoff from the ground (``ModeAuto::takeoff_start``)."""


class Auto(VehicleMode):
    """Runs the mission from its current item."""

    number = ModeNumber.AUTO
    armable = False
    needs_mission = True

    def __init__(self, vehicle: StandinVehicle) -> None:
        super().__init__(vehicle)
        self._started = self._begun = False
        self._item: StandinItem | None = None
        self._revision = 0
        self._held_s = 0.0
        self._arrived = False
        self._takeoff: Takeoff | None = None
        self._return: ReturnSequence | None = None

    def refusal(self) -> str:
        """Besides what all modes ask for: a mission that leaves the ground."""
        refusal = super().refusal()
        mission = self.vehicle.mission
        first = mission.next_flown(max(mission.current, 1))
        if not refusal and self.vehicle.landed and (first is None or first.command != Command.TAKEOFF):
            self.vehicle.say(Severity.CRITICAL, "Auto: Missing Takeoff Cmd")
            refusal = "init failed"
        return refusal

    def enter(self) -> None:
        """Be at the item where the mission was stopped, or at the first."""
        self._started = self._begun = False
        self._item = None
        self.vehicle.mission.begin()

    def start(self) -> None:
        """Leave the ground, for which MAV_CMD_MISSION_START is waited; a mission that is complete begins anew."""
        if not self.vehicle.mission.running:
            self.enter()
        self._started = True

    def update(self, step_s: float) -> None:
        """Go on with the item."""
        mission = self.vehicle.mission
        if self.vehicle.landed and not self._started:
            self.vehicle.drive = Drive.IDLE
            return
        if mission.running and (mission.jumped or not self._begun):
            self._started, self._begun, mission.jumped = True, True, False
            self._start_item(mission.current)
        elif self._revision != mission.revision:
            self._take_changed()
        self._revision = mission.revision
        item = self._item
        if item is not None and self._fly(item, step_s):
            self._start_item(item.seq + 1, item)

    def touched_ground(self) -> None:
        """Disarm after LAND, of which ArduCopter does not say that it is reached; after RTL, if that was all."""
        item = self._item
        if item is not None and item.command == Command.LAND:
            self.vehicle.disarm(force=False)
        elif item is not None and item.command == Command.RETURN_TO_LAUNCH:
            self._start_item(item.seq + 1, item)

    def _take_changed(self) -> None:
        """Fly to the place that an item has in a mission that was uploaded meanwhile."""
        item = self._item
        new = None if item is None else self.vehicle.mission.item(item.seq)
        if (
            item is None
            or new is None
            or new == item
            or item.command not in (Command.WAYPOINT, Command.LOITER_TIME)
        ):
            return
        self._start_item(item.seq)
        self.vehicle.say(Severity.CRITICAL, "Auto mission changed, restarted command")

    def _start_item(self, seq: int, reached: StandinItem | None = None) -> None:
        """Begin the next item that is flown, after those before it that only set something.

        ArduCopter says once in a while which was reached last: of an item and a setting after it, the setting. Of
        settings at the end of a mission it runs the first alone, and says of none that it was reached.
        """
        item = self.vehicle.mission.next_flown(seq)
        settings = [self.vehicle.mission.item(number) for number in range(seq, item.seq if item else seq + 1)]
        if reached is not None and (item is None or not settings):
            self.vehicle.tell(ItemReached(reached.seq))
        if reached is not None and reached.command in (Command.WAYPOINT, Command.LOITER_TIME):
            self.vehicle.say(Severity.INFO, f"Reached command #{reached.seq}")
        for setting in settings:
            if setting is not None:
                self._set(setting)
                if item is not None:
                    self.vehicle.tell(ItemReached(setting.seq))
        if item is None:
            self._end()
        else:
            self.vehicle.mission.current = item.seq
            self.vehicle.say(Severity.INFO, f"Mission: {item.seq} {_NAMES[item.command]}")
            self._begin(item)

    def _set(self, item: StandinItem) -> None:
        self.vehicle.say(Severity.INFO, f"Mission: {item.seq} {_NAMES[item.command]}")
        if item.param2 > 0 and item.param1 in SPEED_KINDS:
            self.vehicle.change_speed(SpeedKind(int(item.param1)), item.param2)

    def _end(self) -> None:
        """The mission is complete: hold here (in the air), or disarm (on the ground)."""
        self._item = None
        self.vehicle.mission.end(complete=True)
        if self.vehicle.landed:
            self.vehicle.disarm(force=False)
        else:
            self.vehicle.navigator.stop()

    def _begin(self, item: StandinItem) -> None:
        # As ArduCopter: from a point that is reached on, not from where the vehicle happens to be near it.
        present = self.vehicle.navigator.target_ned_m() if self._arrived else self.vehicle.position_ned_m
        self._item = item
        self._held_s = 0.0
        self._arrived = False
        self._takeoff = self._return = None
        if item.command == Command.TAKEOFF:
            down_m = self.vehicle.depth_of(item.alt_amsl_m(self.vehicle.home_or_origin))
            if self.vehicle.landed:
                down_m = min(down_m, self.vehicle.position_ned_m[2] - TAKEOFF_RISE_MIN_M)
            self._takeoff = Takeoff(self.vehicle, down_m)
        elif not self.vehicle.landed:  # nothing but a takeoff leaves the ground
            self.vehicle.drive = Drive.FOLLOW
            if item.command == Command.RETURN_TO_LAUNCH:
                self.vehicle.navigator.stop()
                self._return = ReturnSequence(self.vehicle)
            else:
                self._aim(item, self.vehicle.origin.offset(*present))

    def _aim(self, item: StandinItem, present: Location) -> None:
        level = item.command == Command.LAND
        if level and item.is_here:
            self.vehicle.navigator.stop()
            self._arrived = True
            return
        north_m, east_m, down_m = self.vehicle.origin.ned_to(
            item.location(self.vehicle.home_or_origin, present)
        )
        self.vehicle.navigator.go_to(north_m, east_m)
        self.vehicle.navigator.go_to_depth(self.vehicle.position_ned_m[2] if level else down_m)
        if self.vehicle.parameters["WP_YAW_BEHAVIOR"] != 0:
            self.vehicle.navigator.look_ahead()

    def _fly(self, item: StandinItem, step_s: float) -> bool:
        """Return whether the item is done."""
        if self._takeoff is not None:
            return self._takeoff.update(self.vehicle, step_s)
        if self.vehicle.landed:
            self.vehicle.drive = Drive.IDLE
        elif self._return is not None:
            self._return.update(self.vehicle, step_s)
        else:
            return self._go_there(item, step_s)
        return False

    def _go_there(self, item: StandinItem, step_s: float) -> bool:
        """Fly to the item's point, and land or wait there."""
        self.vehicle.drive = Drive.FOLLOW
        self._arrived = self._arrived or self._near()
        if not self._arrived:
            return False
        if item.command == Command.LAND:
            land(self.vehicle)
            return False
        self._held_s += step_s
        return self._held_s >= item.param1

    def _near(self) -> bool:
        radius_m = max(self.vehicle.parameters["WPNAV_RADIUS"] / 100, 0.1)
        height_off_m = abs(self.vehicle.position_ned_m[2] - self.vehicle.navigator.target_ned_m()[2])
        return (
            self.vehicle.navigator.distance_m(self.vehicle.frame) < radius_m
            and height_off_m < HEIGHT_REACHED_M
        )


_NAMES: dict[int, str] = {
    Command.WAYPOINT: "WP",
    Command.LOITER_TIME: "LoitTime",
    Command.RETURN_TO_LAUNCH: "RTL",
    Command.LAND: "Land",
    Command.TAKEOFF: "Takeoff",
    Command.DO_CHANGE_SPEED: "ChangeSpeed",
}
"""ArduPilot's short names of the commands."""
