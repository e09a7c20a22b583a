"""`lostlink replay`: publish a recorded run on Zenoh, as it was published when it was flown."""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING

import click

from bridge.bus.identity.keyring import Credentials
from bridge.bus.keys import KeyMistake, Keys, checked_chunk
from bridge.bus.session import Session, SessionError, checked_endpoint, open_client, open_router
from bridge.run.every import Every
from bridge.run.process import on_stop_signal
from bridge.timeouts import NEWS_PERIOD_S
from lostlink.cli.exits import tell
from lostlink.cli.number_or_word import SPEED
from lostlink.cli.run_path import RunPath
from lostlink.flight.shown.say import say

if TYPE_CHECKING:
    from lostlink.replay.moment import Moment
    from lostlink.replay.player import Player
    from lostlink.replay.playing.controls import Controls

ZENOH_PORT = 7447
EXIT_USAGE = 2
PLAYED = frozenset({"states", "measurements", "deliveries", "packets", "logged"})
"""Tables, and kinds of streams, that are played beside the truth."""


@click.command(short_help="Publish a recorded run on Zenoh again.")
@click.argument("run", type=RunPath())
@click.option("--speed", type=SPEED, default=1.0, show_default=True, help="Real-time factor, or max.")
@click.option("--from", "begin_s", type=float, metavar="SECONDS", help="Sim time to begin at.")
@click.option("--to", "end_s", type=float, metavar="SECONDS", help="Sim time to end at.")
@click.option("--loop", is_flag=True, help="Begin anew at the end, for ever.")
@click.option("--paused", is_flag=True, help="Show the first tick, and wait for clock/cmd/resume.")
@click.option("--name", help="In the keys, after lostlink/; replay-<name of RUN> unless given.")
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("runs"),
    help="Where runs are kept: a directory is there for as long as the record is played.",
)
@click.option(
    "--zenoh-port", type=int, default=ZENOH_PORT, show_default=True, help="Port of the router; 0: any."
)
@click.option(
    "--connect", metavar="ENDPOINT", help="Publish through this Zenoh router in place of one of our own."
)
@click.option("--quiet", is_flag=True, help="Print mistakes only.")
def replay(
    run: Path,
    speed: float | str,
    begin_s: float | None,
    end_s: float | None,
    loop: bool,
    paused: bool,
    name: str | None,
    out: Path,
    zenoh_port: int,
    connect: str | None,
    quiet: bool,
) -> None:
    """Publish the run in directory RUN, finished or killed, with the keys and messages that it had.

    Keys begin with lostlink/replay-<name of RUN>/: truth/<id>, clock, clock/release, node/<id>/state, rx,
    comm_status, agent and log/<name>, tick/truths, fates, communication, links. What nobody subscribes to is not made.
    An operator (lostlink token) may query clock/cmd/pause, resume, step and seek (seconds), speed (a factor, or max)
    and status.

    \b
    Examples:
      lostlink replay runs/20261121T120000Z-separation
      lostlink replay runs/A --speed 4 --from 60 --to 90 --loop
      lostlink replay runs/A --connect tcp/127.0.0.1:7448 --name A
    """
    from lostlink.cli.records.lost import tell_lost
    from lostlink.replay.player import Player
    from lostlink.replay.playing.place import PREFIX

    try:
        player = Player.open(run)
        tell_lost(run, PLAYED, "not played")
        begin_ns, end_ns = _span(player, begin_s, end_s)
        factor = math.inf if speed == "max" else _checked_speed(float(speed))
        named = _checked_name(name or f"{PREFIX}{run.resolve().name}")
        controls = _controls(player, begin_ns, end_ns, factor, paused=paused)
        with _session(player, out, named, zenoh_port, connect) as (session, keys, endpoint):
            _play(session, keys, endpoint, controls, loop=loop, quiet=quiet)
    except (OSError, ValueError, SessionError) as error:
        tell(error)
        sys.exit(EXIT_USAGE)


def _checked_name(name: str) -> str:
    try:
        return checked_chunk(name)
    except KeyMistake as error:
        raise ValueError(f"--name: {error}") from error


def _checked_speed(speed: float) -> float:
    from lostlink.replay.playing.controls import SPEED_MAX, SPEED_MIN

    if not SPEED_MIN <= speed <= SPEED_MAX:
        raise ValueError(f"--speed {speed:g}: a factor from {SPEED_MIN:g} to {SPEED_MAX:g}, or max")
    return speed


def _span(player: Player, begin_s: float | None, end_s: float | None) -> tuple[int, int]:
    """First and last instant to play, in ns."""
    first_s, last_s = player.begin_ns / 1e9, player.end_ns / 1e9
    begin = first_s if begin_s is None else begin_s
    end = last_s if end_s is None else end_s
    if not (begin <= end and begin <= last_s and end >= first_s):
        raise ValueError(f"--from {begin:g} --to {end:g}: the record has {first_s:g} s to {last_s:g} s")
    return round(max(begin, first_s) * 1e9), round(min(end, last_s) * 1e9)


def _controls(player: Player, begin_ns: int, end_ns: int, speed: float, *, paused: bool) -> Controls:
    from lostlink.replay.playing.controls import Controls
    from lostlink.replay.playing.pace import Pace

    return Controls(player, Pace(speed, begin_ns, monotonic(), paused=paused), begin_ns, end_ns)


@contextmanager
def _session(
    player: Player, out: Path, name: str, port: int, connect: str | None
) -> Iterator[tuple[Session, Keys, str]]:
    """A router of our own with the table of rights of a run, or a client of somebody else's."""
    from lostlink.replay.playing.place import playing_place

    if connect is not None:
        keys = Keys(name)
        with open_client(checked_endpoint(connect), _credentials()) as session:
            yield session, keys, connect
        return
    with (
        playing_place(out, name, player.record.scenario, port) as place,
        open_router(place.info.endpoint, place.guard) as session,
    ):
        session.declare_alive(place.keys.alive("router"))
        yield session, place.keys, place.info.endpoint


def _credentials() -> Credentials | None:
    """As whom to log in to somebody else's router: as `lostlink token` prints it, if that is set."""
    user, password = (os.environ.get(f"LOSTLINK_{name}") for name in ("USER", "PASSWORD"))
    return Credentials(user, password) if user and password else None


def _play(
    session: Session, keys: Keys, endpoint: str, controls: Controls, *, loop: bool, quiet: bool
) -> None:
    from lostlink.replay.playing.process import ReplayProcess, speed_text

    news = Every(NEWS_PERIOD_S)
    last_s = controls.end_ns / 1e9

    def tell(moment: Moment) -> None:
        if not quiet and news.is_due():
            say(f"sim time {moment.sim_time_ns / 1e9:7.2f} s of {last_s:.2f} s")

    if not quiet:
        begin_s = controls.begin_ns / 1e9
        speed = "paused" if controls.pace.paused else speed_text(controls.pace.speed)
        say(f"plays {begin_s:g} s to {last_s:g} s on {keys.prefix}/** at {endpoint}, {speed}")
    process = ReplayProcess(session, keys, controls, loop=loop, on_moment=tell)
    on_stop_signal(process.stop)
    process.run()
    if not quiet and controls.player.now is not None:
        say(f"ends at {controls.player.now.sim_time_ns / 1e9:.2f} s")
