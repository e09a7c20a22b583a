"""How the parts of a run are joined: a choice that no result depends on."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Protocol

from bridge.fleet.crew import Crew
from bridge.fleet.how import How
from bridge.fleet.many import ManyProcesses
from bridge.fleet.one import OneProcess, OneTask
from bridge.fleet.tidings import Tidings
from bridge.run.directory import RunDirectory


class Arrangement(Protocol):
    """The parts of a run, as its supervisor has them.

    Attributes:
        recorder: the process without whose end the record is not complete.
    """

    recorder: str

    @property
    def failed(self) -> int:
        """How many tidings could not be handled."""

    async def start(self) -> None:
        """Start our own processes."""

    async def ready(self) -> None:
        """Wait until they are ready."""

    def go(self) -> None:
        """From now on physics answers autopilots."""

    async def end(self, news: asyncio.Event) -> list[str]:
        """End everything; gives the names of those that had to be killed. ``news``: the record gets on."""


def arrange(
    how: How, run: RunDirectory, crew: Crew, tidings: Tidings, on_phase: Callable[[str], object]
) -> Arrangement:
    """The parts of a run, not started yet."""
    kinds: dict[How, Callable[..., Arrangement]] = {
        "many": ManyProcesses,
        "one": OneProcess,
        "task": OneTask,
    }
    return kinds[how](run, crew, tidings, on_phase)
