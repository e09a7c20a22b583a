"""`lostlink view`: look at a run in the browser."""

from __future__ import annotations

import asyncio
import errno
import logging
import signal
from pathlib import Path

import click

from aps.api.guard import TOKEN_VARIABLE, ApiConfig
from aps.logs.printable import PrintableForm
from bridge.bus.session import SessionError
from bridge.record.tables.truth import TRUTH
from bridge.run.access import RUNS
from bridge.run.directory import RunDirectory, live_runs
from lostlink.cli.exits import fail
from lostlink.cli.run_path import RunPath
from lostlink.flight.shown.say import say
from lostlink.view.beside import PORT, NoView, check_installed, port_conflict

OVER = "the run was over before it could be looked at: `lostlink view RUN` plays its record"
NO_CONTROL = (
    "--control: the run is over, and nobody is there to be commanded; every viewer can move its record"
)


@click.command(short_help="Look at a run in the browser, running or recorded.")
@click.argument("run", required=False, type=RunPath())
@click.option(
    "--control", is_flag=True, help="Viewers may command aircraft; each command is asked about first."
)
@click.option(
    "--port",
    type=click.IntRange(0, 65535),
    default=PORT,
    show_default=True,
    help="TCP port; 0: any free one.",
)
@click.option("--host", default="127.0.0.1", show_default=True, help="Address to listen on.")
@click.option(
    "--token",
    default="",
    envvar=TOKEN_VARIABLE,
    show_envvar=True,
    help="What viewers need; required beyond this machine. Other users of this machine can see an option.",
)
@click.option("--wait", is_flag=True, hidden=True, help="The run is about to start.")
def view(run: Path | None, control: bool, port: int, host: str, token: str, wait: bool) -> None:
    """Serve a page that shows RUN (its directory, or its name in runs/; without it the newest that is running).

    A run that is over is played from its record, at any speed and to any instant. The page needs nothing from the
    Internet. It observes: no result depends on it. With --control it can command the aircraft of a running simulation;
    what it commands takes effect at a tick and is recorded as an input of the run.

    \b
    Examples:
      lostlink view                               the newest run that is running
      lostlink view runs/A --port 8081            a record, or a run that goes on
      lostlink view --control
    """
    try:
        check_installed()
        config = ApiConfig(host=host, port=port, token=token)
        directory = RunDirectory(_directory(run))
        goes_on = wait or is_running(directory)
    except (NoView, OSError) as error:
        fail(error, 1)
    except ValueError as error:
        raise click.UsageError(str(error)) from error
    from lostlink.view.background import ViewDied
    from lostlink.view.process import ViewSettings, view_live, view_record, wait_for_start

    handler = logging.StreamHandler()
    handler.setFormatter(PrintableForm("%(levelname)s %(name)s: %(message)s"))
    logging.basicConfig(level=logging.WARNING, handlers=[handler])
    settings = ViewSettings(config, control, lambda address: say(f"view: {address}"))

    async def serve() -> None:
        stop = asyncio.Event()
        for number in (signal.SIGINT, signal.SIGTERM):
            asyncio.get_running_loop().add_signal_handler(number, stop.set)
        if not goes_on:
            if control:
                say(NO_CONTROL, err=True)
            await view_record(directory, settings, stop)
        elif await wait_for_start(directory, stop, has_begun=not wait):
            await view_live(directory, settings, stop)
        else:
            say(OVER, err=True)

    try:
        asyncio.run(serve())
    except (SessionError, OSError, ValueError, ViewDied) as error:
        if isinstance(error, SessionError) and directory.is_over:
            say(OVER, err=True)  # it ended while we joined it
        elif isinstance(error, OSError) and error.errno == errno.EADDRINUSE:
            fail(port_conflict(port, "--port") or error, 1)
        else:
            fail(error, 1)


def is_running(run: RunDirectory) -> bool:
    """Whether a run goes on: what is over has its tables in their last form, or nobody who would make them.

    Raises:
        OSError, ValueError: it is no run.
    """
    return run.is_live and not TRUTH.parquet_path(run.path).exists()


def _directory(run: Path | None) -> Path:
    if run is not None:
        return run
    running = live_runs(RUNS)
    if not running:
        fail(f"no run goes on in {RUNS}/; start one with `lostlink run`, or name one", 1)
    return RUNS / running[0].run
