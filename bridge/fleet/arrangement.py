"""How the parts of a run are joined, as its supervisor has it: a choice that no result depends on."""

from __future__ import annotations

import asyncio
from abc import ABC, abstractmethod
from collections.abc import Callable

from bridge.fleet.children.crew import Crew
from bridge.fleet.tidings import SampleSorter, Tidings
from bridge.run.directory import RunDirectory


class Arrangement(ABC):
    """The parts of a run.

    Args:
        run: the run.
        crew: starts processes.
        tidings: called with what the parts say.
        on_phase: called with what is waited for.

    Attributes:
        recorder: the process without whose end the record is not complete.
    """

    recorder: str

    def __init__(
        self, run: RunDirectory, crew: Crew, tidings: Tidings, on_phase: Callable[[str], object]
    ) -> None:
        self._run, self._crew, self._tidings, self._on_phase = run, crew, tidings, on_phase
        self._sorter = SampleSorter(run.keys, tidings)

    @property
    def failed(self) -> int:
        """How many tidings could not be handled."""
        return self._sorter.failed

    @abstractmethod
    async def start(self) -> None:
        """Start our own processes.

        Raises:
            FleetError: one cannot be started.
        """

    @abstractmethod
    async def ready(self) -> None:
        """Wait until they are ready.

        Raises:
            FleetError: they are not in time.
        """

    @abstractmethod
    def go(self) -> None:
        """From now on physics answers autopilots."""

    @abstractmethod
    async def end(self, news: asyncio.Event) -> list[str]:
        """End everything; gives the names of those that had to be killed. ``news``: the record gets on."""
