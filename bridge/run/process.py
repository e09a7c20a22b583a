"""What the processes of a run share: arguments, log, and how they end."""

from __future__ import annotations

import argparse
import atexit
import faulthandler
import logging
import signal
import sys
from collections.abc import Callable, Coroutine, Sequence
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from aps.logs.printable import PrintableForm
from aps.logs.repeats import Repeats
from bridge.bus.session import SessionError
from bridge.run.directory import RunDirectory

if TYPE_CHECKING:
    import asyncio

DRIVEN = ("aps", "uvicorn", "aircraft", "host", "replies", "inbox")
"""Loggers whose lines come from what others do, as often as they like: `aps.logs.repeats`."""
STDERR_FD = 2
current_node: ContextVar[str] = ContextVar("current_node", default="")
"""The node that is being worked for, for the log of a process that has several."""


class LogClock:
    """The sim time that the log of this process is at; None before the first tick."""

    now_ns: int | None = None


log_clock = LogClock()


class LogForm(PrintableForm):
    """A line: wall time, sim time (``-`` before the first tick), level, logger, text."""

    def __init__(self) -> None:
        super().__init__("%(asctime)s %(sim_time)s %(levelname)s %(name)s: %(message)s")

    def format(self, record: logging.LogRecord) -> str:
        """Add the sim time."""
        now_ns = log_clock.now_ns
        record.sim_time = "-" if now_ns is None else f"{now_ns / 1e9:.3f}s"
        return super().format(record)


@dataclass(frozen=True, slots=True)
class Arguments:
    """What a process of a run is started with."""

    run: RunDirectory
    name: str
    nodes: tuple[str, ...] = ()


class NodeLogs(logging.Handler):
    """Writes what is logged for a node to the node's own log, and the rest to stderr, the log of the process.

    Args:
        run: whose logs.
        rest: where the rest goes, if not to stderr.

    A record's node is that of the context, or of the agent's thread.
    """

    def __init__(self, run: RunDirectory, rest: logging.Handler | None = None) -> None:
        super().__init__()
        self._run = run
        self._form = LogForm()
        self._rest = Repeats(rest or logging.StreamHandler(sys.stderr), *DRIVEN)
        self._rest.setFormatter(self._form)
        self._of_nodes: dict[str, logging.Handler] = {}

    def emit(self, record: logging.LogRecord) -> None:
        """Write one record."""
        thread = record.threadName or ""
        node = thread.removeprefix("agent-") if thread.startswith("agent-") else current_node.get()
        if node:
            self._handler_of(node).handle(record)
        else:
            self._rest.handle(record)

    def _handler_of(self, node: str) -> logging.Handler:
        handler = self._of_nodes.get(node)
        if handler is None:
            path = self._run.log_path(f"node-{node}")
            file = logging.FileHandler(path, encoding="utf-8", delay=True)
            handler = self._of_nodes[node] = Repeats(file, *DRIVEN)
            handler.setFormatter(self._form)
        return handler

    def close(self) -> None:
        """Close the files."""
        for handler in (*self._of_nodes.values(), self._rest):
            handler.close()
        super().close()


def add_run_arguments(parser: argparse.ArgumentParser, name: str) -> None:
    """The arguments that every process of a run has."""
    parser.add_argument("--run-dir", required=True, help="directory that `lostlink run` made for the run")
    parser.add_argument("--name", default=name, help="what the run calls this process")


def log_to_files(arguments: argparse.Namespace) -> RunDirectory:
    """The run of the arguments; from now on its log goes to the run's files and stderr, with SIGUSR1 all stacks too."""
    run = RunDirectory(Path(arguments.run_dir))
    faulthandler.register(signal.SIGUSR1, file=STDERR_FD)
    logs = NodeLogs(run)
    logging.basicConfig(level=logging.INFO, handlers=[logs])
    atexit.register(logs.close)  # a fork has only what it registers itself
    return run


def parse_arguments(
    words: Sequence[str] | None, name: str, description: str, *, has_nodes: bool = False
) -> Arguments:
    """The run's directory, the process's name, and the nodes that it serves. Sets up the log on stderr.

    ``words`` are those of its command line; None: the process has one of its own.
    """
    parser = argparse.ArgumentParser(prog=name, description=description)
    add_run_arguments(parser, name)
    if has_nodes:
        parser.add_argument("--nodes", required=True, help="node ids of its UA, such as 0,1")
    arguments = parser.parse_args(words)
    nodes = tuple(arguments.nodes.split(",")) if has_nodes else ()
    return Arguments(log_to_files(arguments), arguments.name, nodes)


def on_stop_signal(stop: Callable[[], object]) -> None:
    """Call ``stop`` on SIGTERM and SIGINT."""
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stop())


def exit_status(body: Callable[[], object]) -> int:
    """Run ``body``; an error that a user can mend becomes one line in the log and status 1."""
    try:
        body()
    except (SessionError, OSError, ValueError) as error:
        logging.getLogger("lostlink").error("%s", error)
        return 1
    return 0


def run_until_stopped(body: Callable[[asyncio.Event], Coroutine[Any, Any, None]]) -> int:
    """Run ``body(stop)`` in an asyncio loop, where SIGTERM and SIGINT set ``stop``. Returns the exit status."""
    import asyncio  # late: physics and router do without

    async def main() -> None:
        stop = asyncio.Event()
        for number in (signal.SIGTERM, signal.SIGINT):
            asyncio.get_running_loop().add_signal_handler(number, stop.set)
        await body(stop)

    return exit_status(lambda: asyncio.run(main()))
