"""The process of a run that is one program: reports to its supervisor through a socket."""

from __future__ import annotations

import argparse
import asyncio
import logging
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from functools import partial

from bridge.bus.session import Session, open_router
from bridge.bus.supervisor_socket import SupervisorSocket
from bridge.host.offspring import Offspring
from bridge.program.program import NAME, Go, Program, Tell
from bridge.radio.router.process import login_watch
from bridge.record.events import Report
from bridge.run.directory import RunDirectory
from bridge.run.process import add_run_arguments, log_to_files, run_until_stopped
from fdm.errors import FdmError
from standin.process import StandinError


def main(words: Sequence[str] | None = None) -> int:
    """Run the process, with the words of its command line."""
    parser = argparse.ArgumentParser(prog=NAME, description=__doc__)
    add_run_arguments(parser, NAME)
    parser.add_argument(
        "--tell-fd", type=int, required=True, help="file descriptor of the supervisor's socket"
    )
    parser.add_argument("--glance", action="store_true", help="tell of states and links, too")
    arguments = parser.parse_args(words)
    run = log_to_files(arguments)
    supervisor = SupervisorSocket(arguments.tell_fd)
    offspring = Offspring(Report(run.path, NAME))
    try:
        return run_until_stopped(
            partial(fly, run, supervisor.put, supervisor.told_to_go, looks=arguments.glance)
        )
    except (FdmError, StandinError) as error:
        log = logging.getLogger(NAME)
        if isinstance(error, StandinError):
            log.error("where its code failed:", exc_info=error.__cause__)
        log.error("%s", error)
        return 1
    finally:
        offspring.end()


async def fly(run: RunDirectory, tell: Tell, go: Go, stop: asyncio.Event, *, looks: bool) -> None:
    """Fly the run in this process, with its router if it has one; see `Program`."""
    with ExitStack() as stack:
        report = Report(run.path, "router")
        await Program(run, tell, report, _router(run, report, stack), looks=looks).run(go, stop)


def _router(run: RunDirectory, report: Report, stack: ExitStack) -> Session | None:
    if not run.info.endpoint:
        return None
    stack.enter_context(login_watch(report))
    return stack.enter_context(open_router(run.info.endpoint, run.guard))


if __name__ == "__main__":
    sys.exit(main())
