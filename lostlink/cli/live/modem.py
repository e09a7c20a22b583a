"""`lostlink modem`: a lossy radio link between a ground station and an autopilot, in wall time."""

from __future__ import annotations

import asyncio
import errno
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from lostlink.cli.exits import fail, tell
from lostlink.cli.run_path import RunPath
from lostlink.flight.shown.say import say
from lostlink.flight.signals import ending_signals

if TYPE_CHECKING:
    from bridge.modem.radio_link import LinkPlan
    from lostlink.modem.live import LiveLink

PROGRESS_S = 5.0
FAILED = 1


@click.command(short_help="Put a lossy radio link between a ground station and an autopilot.")
@click.option("--gcs", required=True, metavar="ENDPOINT", help="Where the ground station is.")
@click.option("--autopilot", required=True, metavar="ENDPOINT", help="Where the autopilot is.")
@click.option(
    "--radio",
    metavar="NAME|FILE",
    help="Of both ends; lostlink radios lists them. [sik-433] With --run: one of its radio networks; that where the "
    "nodes have modems unless given, else main.",
)
@click.option(
    "--set",
    "settings",
    multiple=True,
    metavar="KEY=VALUE",
    help="Any value of the radio, as radio.base_loss=0.1 or radio.medium.air_kbps=32. Repeatable.",
)
@click.option("--distance", type=float, metavar="M", help="Over the ground. [100]")
@click.option(
    "--distances",
    type=click.Path(path_type=Path, dir_okay=False, exists=True),
    metavar="FILE",
    help="Distances over time: a CSV file with the columns time_s and distance_m; linear between its rows.",
)
@click.option(
    "--heights",
    nargs=2,
    type=float,
    metavar="M M",
    help="Above ground, of the ground station and of the UA. [the radio's default_height_m]",
)
@click.option(
    "--run",
    type=RunPath(),
    help="The link of two nodes of a recorded run: its radio, their places over time, its seed.",
)
@click.option(
    "--nodes",
    metavar="A,B",
    help="With --run: ids, that of the ground station first; unless given the first two, of those with modems.",
)
@click.option("--seed", type=int, help="Of all that is drawn. [1]")
@click.option(
    "--baud",
    type=int,
    help="Of both serial lines; 0: none. [with --run as its modems', else 57600 with SiK, 460800 with ELRS, else 0]",
)
@click.option("--duration", type=float, metavar="SECONDS", help="End after so long; else with Ctrl-C.")
@click.option(
    "--json", "as_json", is_flag=True, help="Print a summary as JSON at the end, and nothing else on stdout."
)
@click.option("--quiet", is_flag=True, help="Say nothing until the end.")
def modem(gcs: str, autopilot: str, duration: float | None, as_json: bool, quiet: bool, **asked: Any) -> None:
    """Put a pair of telemetry modems, and the radio link between them, between a ground station and an autopilot.

    In wall time, without a simulation: bytes leave each host at the baud rate, wait in its modem's buffer, go over
    the air as the firmware packs them, meet path loss, shadowing, fading and noise at the distance given, and come
    out at the other side. SiK and ELRS modems put RADIO_STATUS into their own serial side, so that autopilots slow
    down as they do in the field.

    \b
    Endpoints:
      tcp:HOST:PORT          connects, and again when it is lost (SITL: tcp:127.0.0.1:5760)
      tcpin:HOST:PORT        listens; :PORT alone is on this machine
      udp:HOST:PORT          sends there, and takes what comes back
      udpin:HOST:PORT        waits for whoever sends, and answers
      pty                    makes a pseudo-terminal, and prints its name
      serial:DEVICE[:BAUD]   a serial line

    \b
    Examples:
      lostlink modem --gcs tcpin::5770 --autopilot tcp:127.0.0.1:5760 --radio sik-433 --distance 500
      lostlink modem --gcs udp:127.0.0.1:14550 --autopilot tcp:127.0.0.1:5760 --distances away.csv --seed 7
      lostlink modem --gcs pty --autopilot serial:/dev/ttyACM0:57600 --radio elrs-900-200 --distance 3000
      lostlink modem --gcs tcpin::5770 --autopilot tcp::5760 --run runs/A --nodes 0,1
      lostlink modem --gcs tcpin::5770 --autopilot tcp::5760 --set radio.base_loss=0.05 --duration 60 --json
    """
    from bridge.endpoints.address import endpoint_of
    from lostlink.modem.live import LiveLink
    from lostlink.modem.report import summary, summary_lines

    if duration is not None and not 0.0 < duration < math.inf:
        raise click.UsageError(f"--duration {duration:g}: above 0")
    try:
        endpoints = [endpoint_of(text) for text in (gcs, autopilot)]
    except ValueError as error:
        fail(error)
    plan, head = _planned(**asked)
    live = LiveLink(_opened(plan), dict(enumerate(endpoints)))
    hint: Callable[[str], None] = (lambda _: None) if quiet else tell
    for endpoint in endpoints:
        endpoint.tell = hint
    try:
        asyncio.run(_serve(live, duration, hint))
    except OSError as error:
        advice = "; choose another port, or end what has it" if error.errno == errno.EADDRINUSE else ""
        fail(f"cannot open {error.strerror}{advice}", FAILED)
    told = summary(live, head)
    if as_json:
        click.echo(json.dumps(told))
    else:
        for line in summary_lines(told):
            say(line)


def _planned(
    run: Path | None, nodes: str | None, baud: int | None, **asked: Any
) -> tuple[LinkPlan, dict[str, Any]]:
    """The link that options ask for, and what the summary says of it."""
    from lostlink.modem.plan import Asked, plan_of, plan_of_run

    given = {key: value for key, value in asked.items() if value not in (None, ())}
    if run is None and nodes is not None:
        raise click.UsageError("--nodes are those of a recorded run: it needs --run")
    if "distance" in given and "distances" in given:
        raise click.UsageError("--distance and --distances: choose one")
    network = given.pop("radio", None) if run is not None else None
    if run is not None and given:
        named = ", ".join(f"--{'set' if key == 'settings' else key}" for key in given)
        raise click.UsageError(f"{named}: the recorded run of --run has its own")
    try:
        if run is not None:
            plan = plan_of_run(run, nodes.split(",") if nodes else None, baud, network)
        else:
            names = {"distance": "distance_m", "heights": "heights_m"}
            plan = plan_of(Asked(**{names.get(key, key): value for key, value in given.items()}, baud=baud))
    except (ValueError, OSError) as error:
        fail(error)
    return plan, {"radio": plan.radios[0].config.name, "seed": plan.seed}


def _opened(plan: LinkPlan) -> Any:
    from bridge.modem.radio_link import RadioLink

    try:
        return RadioLink(plan)
    except ValueError as error:
        fail(error)


async def _serve(live: LiveLink, duration_s: float | None, hint: Callable[[str], None]) -> None:
    """Keep the link up for so long, or until a signal."""
    from lostlink.modem.report import Tally, progress

    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in ending_signals():
        loop.add_signal_handler(number, stop.set)
    ends_s = None if duration_s is None else loop.time() + duration_s
    try:
        await live.open()
        hint(f"ready: ground station at {live.endpoints[0].name}, autopilot at {live.endpoints[1].name}")
        tally = Tally.of(live)
        while not stop.is_set() and (ends_s is None or loop.time() < ends_s):
            left_s = PROGRESS_S if ends_s is None else min(PROGRESS_S, ends_s - loop.time())
            try:
                async with asyncio.timeout(left_s):
                    await stop.wait()
            except TimeoutError:
                line, tally = progress(live, tally)
                hint(line)
    finally:
        await live.close()
