"""What autopilots have on board, read from the record of their MAVLink while it is written, or afterwards.

The run takes no part in it: no process of it is asked, and nothing is subscribed to. What is read is at most a second
of wall time old (`bridge.timeouts.FLUSH_PERIOD_S`). Of a UA that no page looks at nothing is read.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path

from aps.wire.framer import Frame, Framer
from bridge.record.names import from_autopilot, to_autopilot
from bridge.record.streams import StreamFollower
from lostlink.view.picture.onboard import Onboard, Sieve

PERIOD_S = 0.25
"""How often it is looked whether there is more, by wall time."""
SLICE_BYTES = 1 << 17
"""Read at once: viewers are served in between."""
Rare = tuple[int, bool, Frame]
"""Sim time in ns, whether it went to the autopilot, and a frame that matters."""


class OnboardLog:
    """One UA's MAVLink, of which what matters is kept.

    Args:
        run: the run directory.
        node: the UA's id.
    """

    def __init__(self, run: Path, node: str) -> None:
        streams = ((from_autopilot(node), False), (to_autopilot(node), True))
        self._sides = [
            (StreamFollower(stream.path(run)), Framer(trusting=True), to) for stream, to in streams
        ]
        self._sieve = Sieve()
        self._kept: list[Rare] = []
        self._folded = 0
        self._onboard = Onboard()

    def read(self) -> bool:
        """Read the next slice of either direction; whether there was any.

        Raises:
            StreamError, OSError: the record is damaged or cannot be read.
        """
        found: list[Rare] = []
        is_more = False
        for follower, framer, to in self._sides:
            entries = follower.read(SLICE_BYTES)
            is_more = is_more or entries is not None
            for tick_ns, data in entries or ():
                frames = framer.receive(data)
                found += [
                    (tick_ns, to, each) for each in frames if self._sieve.is_news(each, to_autopilot=to)
                ]
        if found:
            self._keep(found)
        return is_more

    def _keep(self, found: list[Rare]) -> None:
        """In order, the autopilot's first at each tick; what is late goes between what is there."""
        found.sort(key=_order)
        is_late = bool(self._kept) and _order(found[0]) < _order(self._kept[-1])
        self._kept += found
        if is_late:
            self._kept.sort(key=_order)
            self._begin()

    def _begin(self) -> None:
        self._folded, self._onboard = 0, Onboard()

    def at(self, sim_time_ns: int) -> Onboard:
        """What was on board at an instant, by what was read; the same object is changed by later calls."""
        if self._folded and self._kept[self._folded - 1][0] > sim_time_ns:
            self._begin()
        while self._folded < len(self._kept) and self._kept[self._folded][0] <= sim_time_ns:
            tick_ns, to, frame = self._kept[self._folded]
            self._onboard.take(tick_ns, frame, to_autopilot=to)
            self._folded += 1
        return self._onboard

    def close(self) -> None:
        """Close the record's files."""
        for follower, _, _ in self._sides:
            follower.close()


def _order(rare: Rare) -> tuple[int, bool]:
    return rare[:2]


class Onboards:
    """What the UA have on board that pages look at.

    Args:
        run: the run directory.
        now_ns: says the sim time that is shown.
        tell: called with a UA's id and why its record cannot be read.
    """

    def __init__(self, run: Path, now_ns: Callable[[], int], tell: Callable[[str, str], object]) -> None:
        self._run, self._now_ns, self._tell = run, now_ns, tell
        self._wanted: set[str] = set()
        self._logs: dict[str, OnboardLog] = {}
        self._found: dict[str, Onboard] = {}
        self._lost: set[str] = set()

    def of(self, node: str) -> Onboard | None:
        """What a UA has on board now; a page that goes on asking gets what is new. None until it was read."""
        self._wanted.add(node)
        return self._found.get(node)

    async def run(self) -> None:
        """Read what is asked for, until cancelled."""
        try:
            while True:
                await self.read_wanted()
                await asyncio.sleep(PERIOD_S)
        finally:
            self.close()

    async def read_wanted(self) -> None:
        """Read what was asked for since the last call."""
        wanted, self._wanted = self._wanted - self._lost, set()
        for node in sorted(wanted):
            await self._read(node)

    async def _read(self, node: str) -> None:
        if node not in self._logs:
            self._logs[node] = OnboardLog(self._run, node)
        log = self._logs[node]
        try:
            while await asyncio.to_thread(log.read):
                pass
        except (OSError, ValueError) as error:
            self._lost.add(node)
            self._tell(node, f"the record of its MAVLink cannot be read: {error}")
        self._found[node] = log.at(self._now_ns())

    def close(self) -> None:
        """Close the record's files."""
        for log in self._logs.values():
            log.close()
