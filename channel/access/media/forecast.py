"""Which broadcasts of a DCF network are likely to start when, so that their world can look at all of them together."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from channel.access.packets import AirFrame
from channel.access.timing import Wifi


class Forecast:
    """Frames that wait for the end of others that they hear, DIFS and a back-off, and may have to wait again.

    Errors, EIFS and collisions are left out.

    Args:
        frames: one of each station, each as if the medium were idle.
        delays_ns: of each, to those who hear it.
        timing: of slots and windows.
        cca_ns: how long a carrier is there before it is sensed.
        backoff: what a station will draw next, slots.
    """

    def __init__(
        self,
        frames: Sequence[AirFrame],
        delays_ns: Sequence[Mapping[int, int]],
        timing: Wifi,
        cca_ns: int,
        backoff: Callable[[int], int],
    ) -> None:
        self._frames, self._timing, self._cca_ns, self._backoff = frames, timing, cca_ns, backoff
        self._delays_ns = delays_ns
        self._slots: dict[int, int] = {}
        """Those that wait, and what is left of their back-off ..."""
        self._counts_from_ns: dict[int, int] = {}
        """... since this instant."""

    def frames(self) -> list[AirFrame]:
        """The frames, with the instants at which they start."""
        turns = [(frame.started_ns, number) for number, frame in enumerate(self._frames)]
        heapq.heapify(turns)
        started: list[AirFrame] = []
        last = -1, 0
        while turns:
            at_ns, number = heapq.heappop(turns)
            again_ns = self._waits_until_ns(at_ns, number, *last)
            if again_ns is None:
                ended_ns = at_ns + self._duration_ns(number)
                started.append(replace(self._frames[number], started_ns=at_ns, ended_ns=ended_ns))
                last = number, at_ns
            else:
                heapq.heappush(turns, (again_ns, number))
        return started

    def _waits_until_ns(self, at_ns: int, number: int, last: int, last_at_ns: int) -> int | None:
        """When it is a frame's turn again, if the last one before it is in its way."""
        delay_ns = self._delays_ns[last].get(self._frames[number].node) if last >= 0 else None
        if delay_ns is None:
            return None
        sensed_ns = last_at_ns + delay_ns + self._cca_ns
        counts_from_ns = last_at_ns + self._duration_ns(last) + delay_ns + self._timing.difs_ns
        if not sensed_ns < at_ns < counts_from_ns:
            return None
        if number in self._slots:
            passed = (sensed_ns - self._counts_from_ns[number]) // self._timing.slot_ns
            self._slots[number] = max(self._slots[number] - max(passed, 0), 0)
        else:
            self._slots[number] = self._backoff(self._frames[number].node)
        self._counts_from_ns[number] = counts_from_ns
        return counts_from_ns + self._slots[number] * self._timing.slot_ns

    def _duration_ns(self, number: int) -> int:
        frame = self._frames[number]
        return frame.ended_ns - frame.started_ns
