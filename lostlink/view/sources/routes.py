"""By which nodes packets come, read from the record while it is written, or afterwards: the run takes no part in it."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path

from bridge.record.tables.routes import ROUTES
from lostlink.reading.links.routes import Ends, LinkWays, Way, ways_of

PERIOD_S = 1.0
"""How often it is read while a run goes on, by wall time: as often as it is written."""


class RoutesOfRun:
    """The ways of packets.

    Args:
        run: the run directory.
        nodes: ids of all nodes.
        now_ns: says the sim time that is shown.
        tell: called with why the table cannot be read.
    """

    def __init__(
        self, run: Path, nodes: Sequence[str], now_ns: Callable[[], int], tell: Callable[[str], object]
    ) -> None:
        self._run, self._nodes, self._now_ns, self._tell = run, tuple(nodes), now_ns, tell
        self._ways: Mapping[str, Mapping[Ends, LinkWays]] = {}
        """By radio network."""
        self._files: list[tuple[Path, int]] = []
        """As they were when they were read."""

    def of(self, network: str, tx: int, rx: int) -> Way:
        """Who transmitted the latest packet that came, from its sender on; empty: none came, or none is handed on."""
        ways = self._ways.get(network, {}).get((tx, rx))
        return () if ways is None else ways.at(self._now_ns())

    async def run(self) -> None:
        """Read what is new, now and then, until cancelled."""
        while True:
            try:
                await self.read()
            except (OSError, ValueError) as error:
                self._tell(f"the record of routes cannot be read: {error}")
                await asyncio.Event().wait()
            await asyncio.sleep(PERIOD_S)

    async def read(self) -> None:
        """Read what is new.

        Raises:
            OSError, ValueError: it cannot be read, or is damaged.
        """
        with suppress(FileNotFoundError):  # its journal has just become a table: that is read the next time
            await asyncio.to_thread(self._read)

    def _read(self) -> None:
        files = [(file, file.stat().st_size) for file in ROUTES.files(self._run)]
        if files != self._files:
            self._ways = ways_of(self._run, self._nodes)
            self._files = files
