"""SiK radios of one NETID, reckoned tick by tick on one channel: written for tests, apart from the code under test.

By what ArduPilot/SiK's `tdm.c` says of its loop; a frame comes to whoever heard it from its start to its end,
transmitted nothing meanwhile, and heard nothing else.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

TICK_US = 16
TICKS_PER_BYTE, LATENCY, SILENCE, WINDOW = 9, 157, 260, 7140
"""At 64 kb/s: (8 + 125) / 16 + 1; 13 * 9 + 13, and 27 more for the longer preamble; 2 * 130; 3 * (130 + 250 * 9)."""
AROUND_BYTES, LEAST_BYTES = 17, 18
"""Preamble 8, sync 2, NETID 2, length 1, trailer 2, CRC 2; nothing is begun where less than 18 bytes fit."""
LOOK_TICKS = 32_769
SYNC_TICKS = 10 * 8 * 1000 // 64 // TICK_US
TRANSMIT, SILENCE1, RECEIVE, SILENCE2 = range(4)


@dataclass(eq=False)
class Frame:
    """On the air: whose, of how many user bytes, from when to when; what its trailer says; who has not lost it."""

    unit: int
    data: int
    start: int
    end: int
    window: int
    bonus: bool
    heard_by: set[int] = field(default_factory=set)


@dataclass(eq=False)
class Unit:
    """One radio: its state of tdm.c, bytes of its host by the tick at which they come, and what came from whom."""

    state: int
    left: int
    host: list[tuple[int, int]]
    look: int
    waiting: int = 0
    tells: bool = False
    bonus: bool = False
    yielded: bool = False
    wait: int = 0
    sends: Frame | None = None
    came: Counter[int] = field(default_factory=Counter)

    def passes_a_tick(self, now: int) -> None:
        while self.host and self.host[0][0] <= now:
            self.waiting += self.host.pop(0)[1]
        self.tells |= now % LOOK_TICKS == self.look
        self.wait = max(self.wait - 1, 0)
        self.left -= 1
        if not self.left:
            self.state = (self.state + 1) % 4
            self.left = WINDOW if self.state in (TRANSMIT, RECEIVE) else SILENCE
            self.bonus, self.yielded, self.wait = False, False, 0

    def may_send(self) -> bool:
        mine = self.state == TRANSMIT or (self.bonus and self.state == RECEIVE)
        return mine and not self.yielded and not self.wait and self.sends is None

    def takes(self, frame: Frame) -> None:
        self.wait = 0
        self.came[frame.unit] += frame.data
        if not frame.window:
            return
        if not frame.bonus:
            self.state, self.left = RECEIVE, frame.window
        elif self.state == SILENCE1:
            self.left = SILENCE
        elif self.state == TRANSMIT:
            self.left = frame.window
        else:
            self.state, self.left = SILENCE2, 1
        self.bonus = self.state == RECEIVE and not frame.data
        if self.state != TRANSMIT:
            self.yielded = False


def begins(number: int, unit: Unit, now: int) -> Frame | None:
    """What a unit puts on the air now: a part of its stream, statistics (no window), or nothing (it yields)."""
    room = (unit.left - LATENCY) // TICKS_PER_BYTE
    if room < LEAST_BYTES:
        return None
    data = min(unit.waiting, room - 3, 250)
    unit.waiting -= data
    told = not data and unit.tells and unit.state == TRANSMIT
    unit.tells &= not told
    unit.yielded = not data and not told
    ticks = -(-(4 * told + data + AROUND_BYTES) * 8 * 1000 // 64 // TICK_US)
    window = 0 if told else max(unit.left - ticks, 1)
    return Frame(number, data, now, now + ticks, window, bonus=unit.state != TRANSMIT)


def reckoned(host: Sequence[Sequence[tuple[int, int]]], looks: Sequence[int], seconds: float) -> list[Unit]:
    """Units live for a while; all but the first are half a round behind it.

    Args:
        host: (tick, bytes) that come to each.
        looks: at which tick of each 0.51 s each is to tell its statistics.
        seconds: how long.
    """
    first = Unit(TRANSMIT, WINDOW, list(host[0]), looks[0])
    others = zip(host[1:], looks[1:], strict=True)
    units = [first, *(Unit(RECEIVE, WINDOW, list(each), look) for each, look in others)]
    on_air: list[Frame] = []
    for now in range(int(seconds * 1e6 / TICK_US)):
        for frame in [frame for frame in on_air if frame.end == now]:
            on_air.remove(frame)
            units[frame.unit].sends, units[frame.unit].wait = None, LATENCY
            for other in frame.heard_by:
                units[other].takes(frame)
        for number, unit in enumerate(units):
            unit.passes_a_tick(now)
            if not unit.may_send():
                continue
            if any(number in each.heard_by and now >= each.start + SYNC_TICKS for each in on_air):
                unit.wait = LATENCY
            elif (frame := begins(number, unit, now)) is not None:
                _transmit(frame, unit, units, on_air)
    return units


def _transmit(frame: Frame, unit: Unit, units: Sequence[Unit], on_air: list[Frame]) -> None:
    """Whoever transmits hears nothing; two at once spoil each other for all others."""
    for other in on_air:
        other.heard_by.clear()
    if not on_air:
        frame.heard_by = {each for each in range(len(units)) if each != frame.unit}
    unit.sends = frame
    on_air.append(frame)
