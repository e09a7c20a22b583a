"""Parameters over MAVLink's parameter protocol: read one, set some, get all. No I/O, no clock.

Values are what people write: ArduPilot sends every type as a float, PX4 sends integers as the bytes of one; ``decoded``
and ``set_message`` know both. (https://mavlink.io/en/services/parameter.html)
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from typing import Any, Final

from aps.timeouts import PARAMETER_GAP_S, TRANSFER_TIMEOUTS_S
from aps.vehicle.autopilots.choice import autopilot_of
from aps.vehicle.execution import NS_PER_S, Execution, Outcome
from aps.vehicle.telemetry import VehicleState
from aps.wire.dialect import AUTOPILOT_COMPID, enum_label, mavlink

NAME_CHARS: Final = 16
SYSTEM_ID_PARAMETERS: Final = frozenset({"MAV_SYSID", "SYSID_THISMAV", "MAV_SYS_ID"})
"""What an autopilot calls itself: ArduPilot (from 4.7 on, before) at once, PX4 after a reboot."""
GAPS_AT_ONCE: Final = 10
"""Missing parameters that are asked for together."""
MAX_CHANGES: Final = 16
"""How often a list is begun anew whose length changes: each change may count thrice, with what is late."""
NO_INDEX: Final = 0xFFFF
FEEDBACK_PARAMETERS: Final = 100
_LAYOUTS: Final = {1: "B", 2: "b", 3: "H", 4: "h", 5: "I", 6: "i"}
"""MAV_PARAM_TYPE of whole numbers -> its layout in the four bytes of a value."""
_LIMITS: Final = {
    1: (0, 255),
    2: (-128, 127),
    3: (0, 65_535),
    4: (-32_768, 32_767),
    5: (0, 2**32 - 1),
    6: (-(2**31), 2**31 - 1),
}


def checked_name(name: Any) -> str:
    """A parameter's name in capitals.

    Raises:
        ValueError: it cannot be one.
    """
    if (
        not isinstance(name, str)
        or not 0 < len(name) <= NAME_CHARS
        or not name.isascii()
        or not name.replace("_", "a").isalnum()
    ):
        raise ValueError(f"{name!r} is no parameter's name: up to {NAME_CHARS} letters, digits and _")
    return name.upper()


class _BytewiseParamSet(mavlink.MAVLink_param_set_message):  # type: ignore[misc]
    """PARAM_SET whose value is four bytes: on its way through a float a signalling NaN would lose a bit."""

    unpacker = struct.Struct("<4sBB16sB")


def _is_bytewise(kind: int, autopilot: int) -> bool:
    return kind in _LIMITS and autopilot_of(autopilot).bytewise_parameters


def decoded(fields: Mapping[str, Any], autopilot: int) -> float:
    """What a PARAM_VALUE means: its fields, and ``param_bytes``, those of its value."""
    kind = int(fields["param_type"])
    if _is_bytewise(kind, autopilot):
        return float(struct.unpack_from("<" + _LAYOUTS[kind], fields["param_bytes"])[0])
    return float(fields["param_value"])


def set_message(sysid: int, name: str, value: float, kind: int, autopilot: int) -> Any:
    """PARAM_SET as the autopilot reads it."""
    target = (sysid, AUTOPILOT_COMPID, name.encode("ascii"))
    if _is_bytewise(kind, autopilot):
        return _BytewiseParamSet(
            *target, struct.pack("<" + _LAYOUTS[kind], round(value)).ljust(4, b"\0"), kind
        )
    return mavlink.MAVLink_param_set_message(*target, value, kind)


def as_float32(value: float) -> float:
    """The value as four bytes can keep it.

    Raises:
        ValueError: it is too large.
    """
    try:
        return float(struct.unpack("<f", struct.pack("<f", value))[0])
    except OverflowError as error:
        raise ValueError(f"{value!r} is too large for a parameter") from error


class _Asking(Execution):
    """Asks for one thing until it is answered."""

    wanted = frozenset({22, 345})  # PARAM_VALUE, PARAM_ERROR

    def __init__(self, verb: str, state: VehicleState, occupies: str = "") -> None:
        super().__init__(verb, occupies)
        self._sysid, self._autopilot = state.sysid, state.autopilot
        self._tries = 0
        self._due_at_ns = 0

    def _read_message(self, name: str, index: int = -1) -> Any:
        return mavlink.MAVLink_param_request_read_message(
            self._sysid, AUTOPILOT_COMPID, name.encode("ascii"), index
        )

    def _due_ns(self) -> int | None:
        return self._due_at_ns

    def _try(self, now_ns: int) -> bool:
        """Whether it may ask once more; the next deadline is set."""
        if self._tries >= len(TRANSFER_TIMEOUTS_S):
            return False
        self._due_at_ns = now_ns + round(TRANSFER_TIMEOUTS_S[self._tries] * NS_PER_S)
        self._tries += 1
        return True


class GetExecution(_Asking):
    """Reads one parameter: the result's value is a number."""

    def __init__(self, state: VehicleState, name: str) -> None:
        super().__init__("parameter_get", state)
        self._name = checked_name(name)

    def _poll(self, state: VehicleState, now_ns: int) -> list[Any]:  # noqa: ARG002
        if now_ns < self._due_at_ns:
            return []
        if not self._try(now_ns):
            self.end(Outcome.TIMED_OUT, f"no answer: there may be no parameter {self._name}")
            return []
        return [self._read_message(self._name)]

    def on_message(self, name: str, fields: Mapping[str, Any], now_ns: int) -> None:  # noqa: ARG002
        """PARAM_VALUE, or that there is none."""
        if fields.get("param_id") != self._name:
            return
        if name == "PARAM_VALUE":
            value = decoded(fields, self._autopilot)
            self.end(Outcome.REACHED, value=value)
        elif name == "PARAM_ERROR":
            self.refuse(enum_label("MAV_PARAM_ERROR", int(fields["error"])))


class SetExecution(_Asking):
    """Sets parameters one after the other: each is read (for its type), set, and seen to be what was asked.

    Args:
        state: the UA now.
        values: what to set.
        verb: what it is called.
    """

    def __init__(self, state: VehicleState, values: Mapping[str, float], verb: str) -> None:
        super().__init__(verb, state, "parameters" if len(values) > 1 else "")
        self._wanted = list(values.items())
        self._at = 0
        self._kind: int | None = None
        """Type of the one that is being set, once it is known."""
        self._kept: float | None = None
        """What the autopilot reported instead of the value that it was to take."""

    def _poll(self, state: VehicleState, now_ns: int) -> list[Any]:  # noqa: ARG002
        if self._at == len(self._wanted):
            self.end(Outcome.REACHED, value=self._at)
            return []
        if now_ns < self._due_at_ns:
            return []
        name, value = self._wanted[self._at]
        if not self._try(now_ns):
            self._give_up(name, value)
            return []
        if self._kind is None:
            return [self._read_message(name)]
        return [set_message(self._sysid, name, value, self._kind, self._autopilot)]

    def _give_up(self, name: str, value: float) -> None:
        after = f" ({self._at} of {len(self._wanted)} are set)" if len(self._wanted) > 1 else ""
        if self._kept is not None:
            self.refuse(f"the autopilot keeps {name} at {self._kept:g} and does not take {value:g}{after}")
        elif name in SYSTEM_ID_PARAMETERS and self._kind is not None:
            reason = f"no answer: {name} is set if the autopilot calls itself system {value:g} now{after}"
            self.end(Outcome.TIMED_OUT, reason)
        else:
            self.end(Outcome.TIMED_OUT, f"no answer: there may be no parameter {name}{after}")

    def on_message(self, name: str, fields: Mapping[str, Any], now_ns: int) -> None:  # noqa: ARG002
        """PARAM_VALUE of the one that is being set."""
        if self._at == len(self._wanted) or fields.get("param_id") != self._wanted[self._at][0]:
            return
        if name == "PARAM_ERROR":
            self.refuse(f"{self._wanted[self._at][0]}: {enum_label('MAV_PARAM_ERROR', int(fields['error']))}")
        elif name == "PARAM_VALUE":
            self._take(decoded(fields, self._autopilot), fields)

    def on_other_system(self, sysid: int, fields: Mapping[str, Any]) -> None:
        """The system id that is being set, of the autopilot that has it now: nothing else can be set here then."""
        if self._at == len(self._wanted) or self._kind is None:
            return
        name, value = self._wanted[self._at]
        if name not in SYSTEM_ID_PARAMETERS or fields.get("param_id") != name:
            return
        if not value == sysid == decoded(fields, self._autopilot):
            return
        self._next(name)
        if self._at < len(self._wanted):
            count = f"{self._at} of {len(self._wanted)} are set"
            self.interrupt(f"the autopilot calls itself system {sysid} now ({count})")

    def _take(self, value: float, fields: Mapping[str, Any]) -> None:
        name, wanted = self._wanted[self._at]
        kind = int(fields["param_type"])
        low, high = _LIMITS.get(kind, (-math.inf, math.inf))
        sent = wanted if _is_bytewise(kind, self._autopilot) else as_float32(wanted)
        if not low <= wanted <= high or (kind in _LIMITS and wanted != round(wanted)):
            self.refuse(f"{name} is a whole number in {low:g}..{high:g}: {wanted!r} is none")
        elif value == sent:
            self._next(name)
        elif kind in _LIMITS and sent != wanted:  # of 2**31, ArduPilot's conversion is not defined
            self.refuse(
                f"{name} is sent as a four-byte float, which cannot hold {wanted:.0f}: {sent:.0f} is next"
            )
        elif self._kind is None:
            self._kind, self._tries, self._due_at_ns = kind, 0, 0
        else:
            self._kept = value  # perhaps the answer to an earlier question: ask on

    def _next(self, name: str) -> None:
        self._at += 1
        self._kind, self._kept, self._tries, self._due_at_ns = None, None, 0, 0
        self.tell("feedback", f"{name} is set", done=self._at, total=len(self._wanted))


class ListExecution(_Asking):
    """Gets all parameters: the result's value is name -> number, in the autopilot's order.

    The autopilot sends its list; what is missing after a moment of silence is asked for by its number. Where it is seen
    to have more or less parameters than before (ArduPilot, when somebody enables a part of it), the numbers are others
    now, and it is asked for the list anew.
    """

    def __init__(self, state: VehicleState) -> None:
        super().__init__("parameters", state, "parameters")
        self._count: int | None = None
        self._found: dict[int, tuple[str, float]] = {}
        self._asked: set[int] = set()
        """Numbers of those that are asked for one by one."""
        self._listing = True
        """Whether the list is to be asked for."""
        self._changes = 0
        """Of the count."""

    def _poll(self, state: VehicleState, now_ns: int) -> list[Any]:  # noqa: ARG002
        if self._count is not None and len(self._found) >= self._count:
            ordered = (self._found[index] for index in sorted(self._found))
            self.end(Outcome.REACHED, value=dict(ordered))
            return []
        if now_ns < self._due_at_ns:
            return []
        if not self._try(now_ns):
            self.end(Outcome.TIMED_OUT, f"no answer after {self._tries} tries ({self._progress()})")
            return []
        if self._count is None or self._listing:
            return [mavlink.MAVLink_param_request_list_message(self._sysid, AUTOPILOT_COMPID)]
        missing = [index for index in range(self._count) if index not in self._found][:GAPS_AT_ONCE]
        self._asked = set(missing)
        return [self._read_message("", index) for index in missing]

    def on_message(self, name: str, fields: Mapping[str, Any], now_ns: int) -> None:
        """PARAM_VALUE, of our list or of somebody else's question."""
        if name != "PARAM_VALUE":
            return
        count, index = int(fields["param_count"]), int(fields["param_index"])
        if not 0 < count < NO_INDEX:
            return
        self._counted(count)
        if index >= count:
            return  # of a question by name: ArduPilot numbers that -1
        self._listing = False
        fresh = index not in self._found
        value = decoded(fields, self._autopilot)
        self._found[index] = (str(fields["param_id"]), value)
        if fresh:
            last_asked = self._asked == {index}
            self._asked.discard(index)
            self._tries = 0
            self._due_at_ns = now_ns + (0 if last_asked else round(PARAMETER_GAP_S * NS_PER_S))
        if fresh and len(self._found) % FEEDBACK_PARAMETERS == 0:
            self.tell("feedback", self._progress(), done=len(self._found), total=count)

    def _counted(self, count: int) -> None:
        """There are so many, it says. What is late of a list before looks like a change, there and back."""
        if self._count not in (None, count) and self._changes < MAX_CHANGES:
            self._changes += 1
            self._found.clear()
            self._asked.clear()
            self._listing, self._tries, self._due_at_ns = True, 0, 0
        self._count = count

    def _progress(self) -> str:
        return f"{len(self._found)} of {'?' if self._count is None else self._count} parameters"


def get(state: VehicleState, name: str) -> GetExecution:
    """Read a parameter: the result's value is a number.

    Args:
        state: the UA now.
        name: of the parameter.
    """
    return GetExecution(state, name)


def _value(name: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError(f"the value of {name} must be a number, not {value!r}")
    as_float32(value)
    return float(value)


def set_one(state: VehicleState, name: str, value: float) -> SetExecution:
    """Set a parameter; done when the autopilot reports the new value.

    Args:
        state: the UA now.
        name: of the parameter.
        value: what to set it to.
    """
    known = checked_name(name)
    return SetExecution(state, {known: _value(known, value)}, "parameter_set")


def set_all(state: VehicleState, values: dict[str, float]) -> SetExecution:
    """Set several parameters, one after the other; those before one that is refused stay set.

    Args:
        state: the UA now.
        values: name -> value.
    """
    if not isinstance(values, Mapping):
        raise ValueError(f"values must be names and numbers, not {values!r}")
    checked = {checked_name(name): _value(name, value) for name, value in values.items()}
    return SetExecution(state, checked, "parameters_set")
