"""What the processes of a run share: arguments, log, and how they end."""

from __future__ import annotations

import argparse
import asyncio
import logging
import signal
import sys
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any

from bridge.bus.session import SessionError
from bridge.run.directory import RunDirectory


def parse_arguments(name: str, description: str, *, per_ua: bool) -> tuple[RunDirectory, str]:
    """The run's directory and the node id ("" where the process is not one UA's). Sets up the log on stderr."""
    parser = argparse.ArgumentParser(prog=name, description=description)
    parser.add_argument("--run-dir", required=True, help="directory that `lostlink run` made for the run")
    if per_ua:
        parser.add_argument("--ua", required=True, help="node id of the UA, such as 0")
    arguments = parser.parse_args()
    logging.basicConfig(
        level=logging.INFO, stream=sys.stderr, format="%(asctime)s %(levelname)s %(name)s: %(message)s"
    )
    return RunDirectory(Path(arguments.run_dir)), getattr(arguments, "ua", "")


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

    async def main() -> None:
        stop = asyncio.Event()
        for number in (signal.SIGTERM, signal.SIGINT):
            asyncio.get_running_loop().add_signal_handler(number, stop.set)
        await body(stop)

    return exit_status(lambda: asyncio.run(main()))
