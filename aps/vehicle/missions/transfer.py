"""The MAVLink mission protocol from our side: upload, download, clear. No I/O, no clock.

Upload: we send MISSION_COUNT, the autopilot asks for each item, and closes with MISSION_ACK. Download: we ask for the
list, then for each item, and close with MISSION_ACK ourselves. Whoever waits repeats what it said last: the time for
that runs by the instants that are passed in. (https://mavlink.io/en/services/mission.html)
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

from aps.timeouts import REASON_GRACE_S, TRANSFER_TIMEOUTS_S
from aps.vehicle.autopilots.choice import autopilot_of
from aps.vehicle.execution import NS_PER_S, Execution, Outcome
from aps.vehicle.missions.items import KINDS, MissionItem, first_seq, items_of
from aps.vehicle.status_text import StatusText, reasons
from aps.vehicle.telemetry import VehicleState
from aps.wire.dialect import AUTOPILOT_COMPID, enum_label, mavlink

TRANSFER: Final = "transfer"
FEEDBACK_ITEMS: Final = 10
"""Items between two pieces of feedback."""
_ACCEPTED: Final = int(mavlink.MAV_MISSION_ACCEPTED)
_DENIED: Final = int(mavlink.MAV_MISSION_DENIED)
_CANCELLED: Final = int(mavlink.MAV_MISSION_OPERATION_CANCELLED)
_SEQUENCE: Final = int(mavlink.MAV_MISSION_INVALID_SEQUENCE)
_ERROR: Final = int(mavlink.MAV_MISSION_ERROR)
_CHECKS: Final = "PreArm:"
"""Begins what ArduPilot says of them."""
_NEEDED: Final = {"fence": 1, "rally": 7}
"""Parameters that have to be numbers: radius or number of vertices, and height. NaN ends a simulated ArduPilot."""
MAX_BEGINNINGS: Final = 3
"""How often an upload is begun whose acknowledgement is lost each time."""


def kind_number(kind: str) -> int:
    """MAV_MISSION_TYPE of a name in ``KINDS``.

    Raises:
        ValueError: there is none.
    """
    if kind not in KINDS:
        raise ValueError(f"kind {kind!r} is none of {', '.join(KINDS)}")
    return KINDS[kind]


class _Transfer(Execution):
    """What is said again and again until an answer comes."""

    wanted = frozenset({40, 44, 47, 51, 73})  # MISSION_REQUEST, _COUNT, _ACK, _REQUEST_INT, _ITEM_INT

    def __init__(self, verb: str, sysid: int, kind: str) -> None:
        super().__init__(verb, TRANSFER)
        self._sysid = sysid
        self._kind = kind_number(kind)
        self._words = kind
        self._said: list[Any] = []
        self._said_ns = 0
        self._due_at_ns: int | None = None
        self._tries = 0
        self._now: list[Any] = []
        self._refusal = ""
        """Why it was refused, while the autopilot may still add words to that."""
        self._texts: list[StatusText] = []

    def on_text(self, text: StatusText) -> None:
        """What it says to the transfer, but for its checks before arming, which it repeats."""
        if not text.text.startswith(_CHECKS):
            self._texts.append(text)

    def _say(self, message: Any, now_ns: int, *, tries: int = 0) -> None:
        """Say something, now and until something else is said."""
        self._said, self._tries = [message], tries + 1
        self._now = [message]
        self._said_ns = now_ns
        self._due_at_ns = now_ns + round(TRANSFER_TIMEOUTS_S[tries] * NS_PER_S)

    def _poll(self, state: VehicleState, now_ns: int) -> list[Any]:
        if self._refusal:
            self._end_refused(now_ns)
        elif self._due_at_ns is None:
            self._begin(state, now_ns)
        elif now_ns >= self._due_at_ns and not self._now:
            if self._tries >= len(TRANSFER_TIMEOUTS_S):
                self.end(Outcome.TIMED_OUT, f"no answer after {self._tries} tries ({self._progress()})")
                return self._parting()
            self._say(self._repeated(), now_ns, tries=self._tries)
        messages, self._now = self._now, []
        return messages

    def _repeated(self) -> Any:
        """What is said when no answer came in time."""
        return self._said[0]

    def _due_ns(self) -> int | None:
        return self._due_at_ns

    def on_message(self, name: str, fields: Mapping[str, Any], now_ns: int) -> None:
        """A message of the protocol, of this kind of list."""
        if (
            self.result is not None
            or self._refusal
            or self._due_at_ns is None
            or fields.get("mission_type", 0) != self._kind
        ):
            return
        if name == "MISSION_ACK":
            self._on_ack(int(fields["type"]), now_ns)
        else:
            self._on_answer(name, fields, now_ns)

    def _refused(self, result: int, now_ns: int) -> None:
        hint = " (another transfer is under way)" if result == _DENIED else ""
        label = enum_label("MAV_MISSION_RESULT", result).removeprefix("MAV_MISSION_")
        self._refusal = f"{label}{hint}{self._place()}"
        self._due_at_ns = now_ns + round(REASON_GRACE_S * NS_PER_S)

    def _end_refused(self, now_ns: int) -> None:
        if now_ns >= (self._due_at_ns or 0):
            words = "; ".join(reasons(self._texts))
            self.refuse(f"{self._refusal}: {words}" if words else self._refusal)

    def _place(self) -> str:
        """Where a transfer was when it was refused, if that says something."""
        return ""

    def _begin(self, state: VehicleState, now_ns: int) -> None:
        raise NotImplementedError

    def _on_answer(self, name: str, fields: Mapping[str, Any], now_ns: int) -> None:
        raise NotImplementedError

    def _on_ack(self, result: int, now_ns: int) -> None:
        if result != _ACCEPTED:
            self._refused(result, now_ns)

    def _progress(self) -> str:
        return self._words

    def _parting(self) -> list[Any]:
        """What is said when we give up."""
        return []


class UploadExecution(_Transfer):
    """Gives the autopilot a list of items, in place of the one that it has.

    Args:
        state: the UA now.
        items: what to give, without home.
        kind: one of ``KINDS``.
    """

    def __init__(self, state: VehicleState, items: Sequence[MissionItem], kind: str) -> None:
        super().__init__("mission_upload", state.sysid, kind)
        self._first = first_seq(self._kind, state.autopilot)
        self._items = [_home(state)] * self._first + list(items)
        self._zero_is_here = autopilot_of(state.autopilot).zero_is_here
        self._count = mavlink.MAVLink_mission_count_message(
            self._sysid, AUTOPILOT_COMPID, len(self._items), self._kind
        )
        self._counted_again = False
        self._beginnings = 0
        self._sent = 0
        """Items that the autopilot has asked for."""
        self._repeats = 0
        """Items said again when all had been sent, whose answer may still come."""

    def _begin(self, state: VehicleState, now_ns: int) -> None:  # noqa: ARG002
        self._offer(now_ns)

    def _offer(self, now_ns: int) -> None:
        self._beginnings += 1
        self._sent = 0
        self._say(self._count, now_ns)

    def _repeated(self) -> Any:
        if self._may_be_late:
            self._counted_again = True
            return self._count
        self._repeats += 0 < self._sent == len(self._items)
        return super()._repeated()

    @property
    def _may_be_late(self) -> bool:
        """A late request, of a transfer before, may have asked for the first item: the count, once more."""
        return self._sent == 1 and not self._counted_again

    @property
    def _all_sent(self) -> bool:
        return self._sent == len(self._items)

    def _on_answer(self, name: str, fields: Mapping[str, Any], now_ns: int) -> None:
        if name not in ("MISSION_REQUEST_INT", "MISSION_REQUEST"):
            return
        seq = int(fields["seq"])
        if not 0 <= seq < len(self._items):
            self.refuse(f"the autopilot asks for item {seq} of {len(self._items)}")
            return
        if seq > self._sent:  # it asks in order: this is late, of a transfer before
            return
        first_time = seq >= self._sent
        self._sent = max(self._sent, seq + 1)
        self._repeats += self._all_sent and not first_time
        message = self._items[seq].to_message(
            self._sysid, seq, self._kind, current=seq == 0, zero_is_here=self._zero_is_here
        )
        self._say(message, now_ns)
        if first_time and (self._sent % FEEDBACK_ITEMS == 0 or self._all_sent):
            self._tell()
        elif first_time and self._sent == 1 and self._beginnings == 1:
            self.tell("accepted", "accepted by the autopilot", done=0, total=len(self._items) - self._first)

    def _tell(self) -> None:
        done, total = self._sent - self._first, len(self._items) - self._first
        self.tell("feedback", self._progress(), done=done, total=total)

    def _on_ack(self, result: int, now_ns: int) -> None:
        if result == _ACCEPTED:
            if self._all_sent and now_ns > self._said_ns:  # else it is late, of one before
                self.end(Outcome.REACHED, value=len(self._items) - self._first)
        elif result == _ERROR and (self._may_be_late or self._repeats):
            self._not_expected(now_ns)
        elif result != _SEQUENCE:  # the answer to an item that came twice: it asks again for the one it wants
            self._refused(result, now_ns)

    def _not_expected(self, now_ns: int) -> None:
        """No refusal for certain: the autopilot was not receiving when an item came, so it is offered the list anew.

        Either it had not heard the count, or it has them all, and how it took them was lost. (ArduPilot,
        GCS_MAVLINK::handle_mission_item. PX4 acknowledges the last item again, MavlinkMissionManager.)
        """
        if self._may_be_late:
            self._counted_again = True
            self._offer(now_ns)
            return
        self._repeats -= 1
        if self._all_sent and self._beginnings < MAX_BEGINNINGS:
            self._offer(now_ns)

    def _place(self) -> str:
        number = self._sent - self._first
        if number < 1:
            return ""
        item = self._items[self._sent - 1]
        command = enum_label("MAV_CMD", item.command).removeprefix("MAV_CMD_")
        return f", after item {number} of {len(self._items) - self._first} ({command}, frame {item.frame})"

    def _progress(self) -> str:
        return f"{self._words}: {self._sent} of {len(self._items)} items sent"

    def _parting(self) -> list[Any]:
        return [_ack(self._sysid, _CANCELLED, self._kind)]


def _ack(sysid: int, result: int, kind: int) -> Any:
    return mavlink.MAVLink_mission_ack_message(sysid, AUTOPILOT_COMPID, result, kind)


def _home(state: VehicleState) -> MissionItem:
    """ArduPilot keeps its own home in place of this item: it is there to be counted."""
    known = state.home_lat_deg == state.home_lat_deg
    place = (state.home_lat_deg, state.home_lon_deg, state.home_alt_amsl_m) if known else (0.0, 0.0, 0.0)
    return MissionItem(int(mavlink.MAV_CMD_NAV_WAYPOINT), (0.0, 0.0, 0.0, 0.0, *place), frame=0)


class DownloadExecution(_Transfer):
    """Gets the list of items that the autopilot has, as ``result.value`` (without home).

    Args:
        state: the UA now.
        kind: one of ``KINDS``.
    """

    def __init__(self, state: VehicleState, kind: str) -> None:
        super().__init__("mission_download", state.sysid, kind)
        self._first = first_seq(self._kind, state.autopilot)
        self._count: int | None = None
        self._items: list[MissionItem] = []
        self._complete = False

    def _begin(self, state: VehicleState, now_ns: int) -> None:  # noqa: ARG002
        asked = mavlink.MAVLink_mission_request_list_message(self._sysid, AUTOPILOT_COMPID, self._kind)
        self._say(asked, now_ns)

    def _on_answer(self, name: str, fields: Mapping[str, Any], now_ns: int) -> None:
        if name == "MISSION_COUNT" and self._count is None:
            self._count = int(fields["count"])
            self.tell(
                "accepted", "accepted by the autopilot", done=0, total=max(0, self._count - self._first)
            )
            self._ask(now_ns)
        elif (
            name == "MISSION_ITEM_INT" and self._count is not None and int(fields["seq"]) == len(self._items)
        ):
            try:
                self._items.append(MissionItem.from_fields(fields))
            except ValueError as error:
                self._now = [_ack(self._sysid, int(mavlink.MAV_MISSION_ERROR), self._kind)]
                self.refuse(f"item {len(self._items)} of the autopilot is none: {error}")
                return
            if len(self._items) % FEEDBACK_ITEMS == 0:
                done, total = len(self._items) - self._first, self._count - self._first
                self.tell("feedback", self._progress(), done=done, total=total)
            self._ask(now_ns)

    def _ask(self, now_ns: int) -> None:
        """Ask for the next item, or close."""
        if len(self._items) < (self._count or 0):
            request = mavlink.MAVLink_mission_request_int_message(
                self._sysid, AUTOPILOT_COMPID, len(self._items), self._kind
            )
            self._say(request, now_ns)
        else:
            self._now = [_ack(self._sysid, _ACCEPTED, self._kind)]
            self._due_at_ns = now_ns
            self._complete = True

    def _poll(self, state: VehicleState, now_ns: int) -> list[Any]:
        messages = super()._poll(state, now_ns)
        if self._complete:
            self.end(Outcome.REACHED, value=[item.to_json() for item in self._items[self._first :]])
        return messages

    def _progress(self) -> str:
        return f"{self._words}: {len(self._items)} of {'?' if self._count is None else self._count} items"

    def _parting(self) -> list[Any]:
        return [_ack(self._sysid, _CANCELLED, self._kind)]


class ClearExecution(_Transfer):
    """Has the autopilot forget a list.

    Args:
        state: the UA now.
        kind: one of ``KINDS``.
    """

    def __init__(self, state: VehicleState, kind: str) -> None:
        super().__init__("mission_clear", state.sysid, kind)

    def _begin(self, state: VehicleState, now_ns: int) -> None:  # noqa: ARG002
        self._say(
            mavlink.MAVLink_mission_clear_all_message(self._sysid, AUTOPILOT_COMPID, self._kind), now_ns
        )

    def _on_answer(self, name: str, fields: Mapping[str, Any], now_ns: int) -> None:
        """Nothing but the acknowledgement answers it."""

    def _on_ack(self, result: int, now_ns: int) -> None:
        super()._on_ack(result, now_ns)
        if result == _ACCEPTED:
            self.end(Outcome.REACHED)


def upload(state: VehicleState, items: list[Any], kind: str = "mission") -> UploadExecution:
    """Give the autopilot a mission, fence or rally points, in place of what it has.

    Args:
        state: the UA now.
        items: MissionItem, or their JSON; without home.
        kind: ``mission``, ``fence`` or ``rally``.

    Raises:
        ValueError: no such kind or items; or one has no place, and the autopilot needs one.
    """
    read, autopilot = items_of(items), autopilot_of(state.autopilot)
    for number, item in enumerate(read):
        if kind != "mission" and item.is_global and not item.is_placed:
            raise ValueError(f"item {number}: a {kind} item needs a latitude and a longitude, not both 0")
        if kind in _NEEDED and math.isnan(item.params[_NEEDED[kind] - 1]):
            command = enum_label("MAV_CMD", item.command)
            raise ValueError(f"item {number}: {command} needs its parameter {_NEEDED[kind]}")
        if item.lacks_place and not autopilot.zero_is_here:
            command = enum_label("MAV_CMD", item.command)
            raise ValueError(
                f"item {number}: {autopilot.name} needs a latitude and a longitude for {command}"
            )
    return UploadExecution(state, read, kind)


def download(state: VehicleState, kind: str = "mission") -> DownloadExecution:
    """Get the mission, fence or rally points that the autopilot has: the result's value is a list of items.

    Args:
        state: the UA now.
        kind: ``mission``, ``fence`` or ``rally``.
    """
    return DownloadExecution(state, kind)


def clear(state: VehicleState, kind: str = "mission") -> ClearExecution:
    """Have the autopilot forget its mission, fence or rally points.

    Args:
        state: the UA now.
        kind: ``mission``, ``fence`` or ``rally``.
    """
    return ClearExecution(state, kind)
