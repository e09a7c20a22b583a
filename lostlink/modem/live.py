"""A link of modems in wall time: moves bytes between hosts and the link, and arms one timer.

The link itself (`bridge.modem`) has no clock. What a host sends enters at the instant at which it was read; a wake-up
that comes late makes bytes late at their host, and changes neither their order nor what the radio does with them.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Final

from bridge.endpoints.endpoint import Endpoint
from bridge.modem.pair import ENDS
from bridge.modem.radio_link import RadioLink
from bridge.modem.units import WholeFrames

NS_PER_S: Final = 1_000_000_000
GRAIN_NS: Final = 4_000_000
"""The timer is armed for no less: what is due within it comes together. A window of SiK takes 110 ms."""
IDLE_NS: Final = 250_000_000
"""So often the radios live on while nothing is under way."""
LATE_NS: Final = 10_000_000
"""Bytes that come out later than this are counted."""
LINE_BYTES, LINE_GOES_ON_BYTES = 512, 256
"""A host is not read while so much of it waits for the serial line; it is again from here on."""
UDP_BYTES: Final = 16_384
"""What may wait of a host that cannot wait."""


@dataclass(slots=True)
class Lateness:
    """How far wall time was behind.

    Attributes:
        outputs: pieces that came out at a host.
        late: those more than 10 ms late.
        worst_ns: the latest.
    """

    outputs: int = 0
    late: int = 0
    worst_ns: int = 0


class LiveLink:
    """The link while it is up.

    Args:
        link: at its instant 0.
        endpoints: of both hosts.
    """

    def __init__(self, link: RadioLink, endpoints: Mapping[int, Endpoint]) -> None:
        self.link, self.endpoints = link, endpoints
        self.lateness = Lateness()
        self.overrun_bytes = dict.fromkeys(ENDS, 0)
        """Of hosts that cannot wait, and sent more than their lines carry."""
        self._frames = {end: WholeFrames() for end in ENDS}
        self._began_ns = 0
        self._timer: asyncio.TimerHandle | None = None
        self._timer_ns = 0
        self._is_closed = False

    @property
    def now_ns(self) -> int:
        """Since it was opened."""
        return time.monotonic_ns() - self._began_ns

    async def open(self) -> None:
        """Open both endpoints; bytes move from now on.

        Raises:
            OSError: one cannot be opened; ``strerror`` begins with its name.
        """
        self._began_ns = time.monotonic_ns()
        for end, endpoint in self.endpoints.items():
            endpoint.on_data = partial(self._received, end)
            try:
                await endpoint.open()
            except OSError as error:
                raise OSError(error.errno, f"{endpoint.name}: {error.strerror or error}") from error
        self._live()

    async def close(self) -> None:
        """Bring out what is due, and close both endpoints; what hosts still send comes to nothing."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
            self._advance(self.now_ns)
        self._is_closed = True
        for endpoint in self.endpoints.values():
            await endpoint.close()

    def _received(self, end: int, data: bytes, host: object) -> None:
        """A host of an end sends."""
        if self._is_closed:
            return
        data = self._frames[end].came(data, host, is_alone=self.endpoints[end].hosts < 2)
        now_ns = self.now_ns
        waits = self.link.pair.modems[end].line_bytes
        if not self.endpoints[end].can_wait and waits > UDP_BYTES:
            self.overrun_bytes[end] += len(data)
        else:
            self.link.receive(end, data, now_ns)
        self._arm(now_ns)

    def _live(self) -> None:
        """The timer has rung."""
        self._timer = None
        now_ns = self.now_ns
        self._advance(now_ns)
        self._arm(now_ns)

    def _advance(self, now_ns: int) -> None:
        out: dict[int, list[bytes]] = {end: [] for end in self.endpoints}
        for end, (at_ns, data) in self.link.advance(now_ns):
            late_ns, lateness = now_ns - at_ns, self.lateness
            lateness.outputs += 1
            lateness.late += late_ns > LATE_NS
            lateness.worst_ns = max(lateness.worst_ns, late_ns)
            out[end].append(data)
        for end, pieces in out.items():
            self.endpoints[end].write_all(pieces)

    def _arm(self, now_ns: int) -> None:
        """Hold hosts whose lines are full, and have the timer ring when something is due."""
        for end, endpoint in self.endpoints.items():
            waits = self.link.pair.modems[end].line_bytes
            if waits > LINE_BYTES:
                endpoint.hold()
            elif waits <= LINE_GOES_ON_BYTES:
                endpoint.go_on()
        if self._timer is not None and self._timer_ns <= now_ns + GRAIN_NS:
            return
        next_ns = self.link.pair.next_ns
        due_ns = now_ns + IDLE_NS if next_ns is None else min(next_ns, now_ns + IDLE_NS)
        due_ns = max(due_ns, now_ns + GRAIN_NS)
        if self._timer is not None:
            if self._timer_ns <= due_ns:
                return
            self._timer.cancel()
        self._timer_ns = due_ns
        self._timer = asyncio.get_running_loop().call_later((due_ns - now_ns) / NS_PER_S, self._live)
