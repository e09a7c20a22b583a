"""What fdm.workers.fleet_exchange and its worker processes (fdm.workers.worker) say to each other, pickled."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from fdm.clock.events import UaEvent
from fdm.errors import FdmError
from fdm.exchange.aircraft_spec import AircraftSpec
from fdm.model.truth import TrueState

COMMANDS = frozenset({"release_tick", "pass_ticks", "set_speed", "pause", "resume", "step", "stop"})
"""Methods of fdm.exchange.exchange.Exchange that are called by name: a command is ``(name, *arguments)``."""

RUN = ("run",)
"""The first command, unless it is to stop: begin to serve."""


@dataclass(frozen=True, slots=True)
class WorkerPlan:
    """What a worker is to do. File descriptors are inherited, under these numbers.

    Attributes:
        index: which worker, from 0.
        aircraft: its UA.
        socket_fds: their sockets, bound.
        board_fd: shared memory of the board.
        wake_fd: reading end of its wake pipe.
        wake_fds: writing ends of all workers' wake pipes.
        settings: further arguments of fdm.exchange.exchange.Exchange.
    """

    index: int
    aircraft: tuple[AircraftSpec, ...]
    socket_fds: tuple[int, ...]
    board_fd: int
    wake_fd: int
    wake_fds: tuple[int, ...]
    settings: Mapping[str, object]


@dataclass(frozen=True, slots=True)
class Ready:
    """Its models are loaded."""


@dataclass(frozen=True, slots=True)
class Reached:
    """Its live UA have reached a tick."""

    sim_time_ns: int
    truths: tuple[TrueState, ...]
    counters: Mapping[int, Mapping[str, int]]


@dataclass(frozen=True, slots=True)
class Happened:
    """Something happened to one of its UA."""

    event: UaEvent


@dataclass(frozen=True, slots=True)
class Ended:
    """It was stopped and has ended; its last counters."""

    counters: Mapping[int, Mapping[str, int]]


@dataclass(frozen=True, slots=True)
class Failed:
    """It has ended with an error: one that is meant for the user, or else the text of its traceback."""

    error: FdmError | None
    trace: str = ""


Message = Ready | Reached | Happened | Ended | Failed
"""What a worker says."""
