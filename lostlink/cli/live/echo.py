"""`lostlink echo`: print what goes over Zenoh, decoded."""

from __future__ import annotations

import json
import queue
import signal
from pathlib import Path

import click
import zenoh

from bridge.bus.identity.keyring import OBSERVERS
from bridge.bus.keys import ROOT
from bridge.bus.samples import as_text, describe
from bridge.bus.session import Sample, SessionError, checked_endpoint, open_client, plain_text
from bridge.run.access import NoAccess, endpoint_of
from bridge.run.directory import RunDirectory, live_runs
from lostlink.cli.exits import fail, tell
from lostlink.flight.shown.say import say

WAITING_MAX = 10_000
"""Samples that may wait for a slow reader of our output; later ones are dropped, and said to be."""


@click.command(short_help="Print decoded samples of a running simulation.")
@click.argument("key")
@click.option("--connect", metavar="ENDPOINT", help="Zenoh router, such as tcp/127.0.0.1:7447.")
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("runs"),
    help="Where runs are kept: joins the newest that is running, unless --connect is given.",
)
@click.option("--count", type=click.IntRange(min=1), help="End after so many samples.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object per line.")
def echo(key: str, connect: str | None, out: Path, count: int | None, as_json: bool) -> None:
    """Print the samples that match KEY (a Zenoh key expression), decoded where they are messages of ours.

    It looks as an observer, who sees everything but what nodes give to their radios (tx), commands, and what the
    radio sends the hosts.

    \b
    Examples:
      lostlink echo 'lostlink/**/node/*/rx/**'
      lostlink echo 'lostlink/*/clock' --count 1
      lostlink echo 'lostlink/*/tick/links' --json
    """
    samples: queue.SimpleQueue[Sample | None] = queue.SimpleQueue()
    dropped: list[None] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: samples.put(None))

    def on_sample(sample: Sample) -> None:
        if samples.qsize() < WAITING_MAX:
            samples.put(sample)
        else:
            dropped.append(None)

    try:
        endpoint = checked_endpoint(connect) if connect else _newest_endpoint(out)
    except NoAccess as error:
        fail(error, 1)
    except ValueError as error:
        raise click.BadParameter(str(error), param_hint="--connect") from error
    try:
        with open_client(endpoint, OBSERVERS) as session:
            try:
                session.subscribe(key, on_sample)
            except zenoh.ZError as error:
                raise click.BadParameter(
                    f"{key!r} is not a Zenoh key expression: {plain_text(error)}", param_hint="KEY"
                ) from error

            def on_router(_key: str, is_alive: bool) -> None:
                if not is_alive:
                    samples.put(None)

            session.watch_alive(f"{ROOT}/*/alive/router", on_router)
            _print_samples(samples, count, as_json=as_json)
        if dropped:
            tell(f"{len(dropped)} samples came faster than they were read")
    except SessionError as error:
        fail(error, 1)


def _newest_endpoint(out: Path) -> str:
    runs = live_runs(out)
    if not runs:
        fail(f"no run goes on in {out}/; start one with `lostlink run`, or give --connect", 1)
    return endpoint_of(RunDirectory(out / runs[0].run))


def _print_samples(samples: queue.SimpleQueue[Sample | None], count: int | None, *, as_json: bool) -> None:
    printed = 0
    while (sample := samples.get()) is not None:
        content = describe(sample)
        say(json.dumps(content) if as_json else as_text(content))
        printed += 1
        if printed == count:
            return
