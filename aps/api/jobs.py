"""The commands that came over the API: under way, and how the latest ended."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from aps.api.backend import DaemonBackend
from aps.vehicle.execution import CommandProgress, CommandResult, Outcome
from aps.vehicle.messages import plain

MAX_UNDER_WAY: Final = 64
MAX_KEPT: Final = 256


class Busy(RuntimeError):
    """Too many commands are under way."""


@dataclass(eq=False)
class Job:
    """One command."""

    id: int
    verb: str
    done: asyncio.Future[CommandResult] = field(repr=False)
    progress: CommandProgress | None = None

    def as_json(self) -> dict[str, Any]:
        """As the API reports it."""
        told: dict[str, Any] = {"id": self.id, "verb": self.verb, "progress": None, "result": None}
        if self.progress is not None:
            told["progress"] = progress_json(self.progress)
        if self.done.done():
            told["result"] = result_json(self.done.result())
        return told


def progress_json(progress: CommandProgress) -> dict[str, Any]:
    """A piece of progress as JSON."""
    return {
        "phase": progress.phase,
        "text": progress.text,
        "remaining_m": progress.remaining_m,
        "done": progress.done,
        "total": progress.total,
    }


def result_json(result: CommandResult) -> dict[str, Any]:
    """A result as JSON."""
    return {
        "verb": result.verb,
        "outcome": result.outcome.value,
        "reason": result.reason,
        "value": plain(result.value),
    }


def _interrupted(verb: str) -> CommandResult:
    return CommandResult(verb, Outcome.INTERRUPTED, "the API ends")


class Jobs:
    """Starts commands and remembers them.

    Args:
        backend: the UA.
        tell: called with each piece of progress and each result, as an event of the stream.
    """

    def __init__(self, backend: DaemonBackend, tell: Callable[[dict[str, Any]], None]) -> None:
        self._backend, self._tell = backend, tell
        self._all: dict[int, Job] = {}
        self._next = 1
        self._is_closed = False

    def start(self, verb: str, arguments: Mapping[str, Any]) -> Job:
        """Start a command.

        Raises:
            ValueError: no such verb, or a wrong argument.
            Busy: too many are under way.
        """
        if sum(not job.done.done() for job in self._all.values()) >= MAX_UNDER_WAY:
            raise Busy(f"{MAX_UNDER_WAY} commands are under way")
        job = Job(self._next, verb, asyncio.get_running_loop().create_future())

        def on_progress(progress: CommandProgress) -> None:
            job.progress = progress
            self._tell({"type": "progress", "id": job.id, "verb": verb, **progress_json(progress)})

        def on_done(result: CommandResult) -> None:
            if not job.done.done():
                job.done.set_result(result)
                self._tell({"type": "result", "id": job.id, **result_json(result)})

        if self._is_closed:
            on_done(_interrupted(verb))
        else:
            self._backend.start(verb, arguments, on_progress, on_done)
        self._next += 1
        self._all[job.id] = job
        self._forget_oldest()
        return job

    def close(self) -> None:
        """No command's end is waited for any more, nor is one started that comes before the connections end."""
        self._is_closed = True
        for job in self._all.values():
            if not job.done.done():
                job.done.set_result(_interrupted(job.verb))

    def _forget_oldest(self) -> None:
        ended = [number for number, job in self._all.items() if job.done.done()]
        for number in ended[: max(0, len(self._all) - MAX_KEPT)]:
            del self._all[number]

    def get(self, number: int) -> Job | None:
        """A command by its number, if it is remembered."""
        return self._all.get(number)

    def all(self) -> list[Job]:
        """All that are remembered, oldest first."""
        return list(self._all.values())
