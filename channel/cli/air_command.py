"""`lostlink air`: what a medium carries, without flying."""

from __future__ import annotations

import json
from collections.abc import Sequence
from math import cos, nan, pi, sin
from pathlib import Path
from time import monotonic
from typing import Any

import click

from channel.access.air import Hearing
from channel.access.media.airtime import AirTime
from channel.access.media.csma import Csma, DcfSettings
from channel.access.media.delay import Delay, DelaySettings, WayDelay
from channel.access.media.elrs import ELRS_MODES, Elrs, ElrsSettings
from channel.access.media.medium import AccessMedium
from channel.access.media.sik.medium import Sik
from channel.access.media.sik.timing import SikSettings
from channel.access.media.tdma import Schedule, Tdma
from channel.access.queue import QueueLimits
from channel.access.settings.csma import standard_energy_dbm
from channel.access.timing import BitRate, Wifi, wifi_a, wifi_b, wifi_g
from channel.access.trial import Carried, Load, under_load
from channel.access.world import PlainWorld, World
from channel.cli.options import FINITE, BadInput, chosen_radio, writing
from channel.numbers.units import ratio_from_db

HEIGHT_M = 40.0
CHOSEN_LOADS = (0.1, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0)
DEFAULT_BPS = 64e3
TELL_PERIOD_S = 2.0
STANDARDS = {"11b": wifi_b, "11a": wifi_a, "11g": wifi_g}


@click.command()
@click.argument("medium", type=click.Choice(["airtime", "csma", "delay", "elrs", "sik", "tdma"]))
@click.option(
    "--nodes", type=click.IntRange(2, 500), help="How many stations; 6 if not given, 2 of elrs and sik."
)
@click.option(
    "--length-bytes", default=200, show_default=True, type=click.IntRange(1), help="Of each packet."
)
@click.option(
    "--to",
    type=click.Choice(["all", "one"]),
    default="all",
    show_default=True,
    help="Broadcasts, or to node 0.",
)
@click.option(
    "--standard", type=click.Choice(list(STANDARDS)), default="11g", show_default=True, help="Of csma."
)
@click.option(
    "--rate-mbps",
    type=FINITE,
    help="Of csma: of unicasts; the lowest of its standard if not given.",
)
@click.option(
    "--basic-rate-mbps",
    type=FINITE,
    help="Of csma: of broadcasts, ACK, RTS and CTS; the lowest of its standard if not given.",
)
@click.option("--rts-from-bytes", type=int, help="Of csma: unicasts of at least so much are announced.")
@click.option(
    "--bitrate-bps",
    type=FINITE,
    help="Of airtime, delay and tdma; if not given 64000, with --radio that radio's.",
)
@click.option(
    "--header-bytes",
    default=0,
    show_default=True,
    type=click.IntRange(0, 1000),
    help="That each packet gets, of airtime, csma, delay and tdma; of csma beside the MAC's 36.",
)
@click.option(
    "--delay-ms",
    nargs=3,
    type=FINITE,
    default=(20.0, 40.0, 100.0),
    show_default=True,
    help="Of delay: the least, the median, and what 95 % do not exceed.",
)
@click.option(
    "--outage-s",
    nargs=2,
    type=FINITE,
    default=(60.0, 0.0),
    show_default=True,
    help="Of delay: mean durations of service and of outage of a node.",
)
@click.option(
    "--in-order/--reorder",
    default=True,
    show_default=True,
    help="Of delay: whether packets of a sender keep their order.",
)
@click.option(
    "--mode", type=click.Choice(list(ELRS_MODES)), default="lora-500", show_default=True, help="Of elrs."
)
@click.option("--rc/--no-rc", default=True, show_default=True, help="Of elrs: beside a remote control.")
@click.option(
    "--slot-ms",
    type=FINITE,
    help="Of tdma: one slot per node and round; one packet and the guard if not given.",
)
@click.option(
    "--guard-ms", default=1.0, type=FINITE, show_default=True, help="Of tdma, at the end of each slot."
)
@click.option(
    "--air-kbps", default=64, show_default=True, type=int, help="Of sik: its rate on the air (AIR_SPEED)."
)
@click.option("--ecc", is_flag=True, help="Of sik: code frames by Golay(23,12).")
@click.option(
    "--framing/--no-framing",
    default=True,
    show_default=True,
    help="Of sik: keep packets whole (MAVLINK = 1), or take them for a stream of bytes.",
)
@click.option(
    "--cold", is_flag=True, help="Of sik: radios are switched on at the start, and have to find each other."
)
@click.option(
    "--queue",
    default=64,
    show_default=True,
    type=click.IntRange(0),
    help="Packets that a node's queue holds; 0: any. Of sik: any, in 1850 bytes.",
)
@click.option(
    "--radio",
    help="A preset or YAML file: powers and errors are its, without shadowing, fading and bursts; with none every "
    "frame comes through alone.",
)
@click.option(
    "--set", "settings", multiple=True, metavar="KEY=VALUE", help="Override a key of the radio. Repeatable."
)
@click.option(
    "--ring-m",
    default=200.0,
    type=FINITE,
    show_default=True,
    help="With --radio: nodes stand on a ring of this radius, 40 m high, node 0 in its middle.",
)
@click.option(
    "--load-bps",
    "loads_bps",
    multiple=True,
    type=FINITE,
    help="Bits of packets a second that all offer together. Repeatable; a series if not given.",
)
@click.option(
    "--duration", "duration_s", default=20.0, type=FINITE, show_default=True, help="Sim time per load, s."
)
@click.option(
    "--seed", default=1, show_default=True, type=int, help="Of traffic, back-off, phases and errors."
)
@click.option("--json", "as_json", is_flag=True, help="Machine-readable output.")
@click.option(
    "--plot",
    type=click.Path(dir_okay=False, path_type=Path),
    help="Draw throughput, delay and losses over load.",
)
def air(medium: str, *, as_json: bool, plot: Path | None, **options: Any) -> None:  # fmt: skip
    """Print what a medium carries: throughput, delay and losses over offered load, without flying.

    \b
    Examples:
      lostlink air csma --nodes 20 --standard 11b --rate-mbps 11 --length-bytes 1500
      lostlink air airtime --bitrate-bps 64000 --nodes 6 --load-bps 20000 --load-bps 60000
      lostlink air tdma --slot-ms 30 --nodes 6 --to one --json
      lostlink air delay --delay-ms 20 45 120 --outage-s 120 5 --bitrate-bps 1e6
      lostlink air elrs --mode 900-200 --to one --length-bytes 40
      lostlink air csma --radio wifi-2.4 --header-bytes 28 --ring-m 400 --plot air.png
      lostlink air sik --nodes 2 --air-kbps 64 --length-bytes 50 --duration 60

    sik: nodes talk two by two in their order; what is for all goes to the other of the two, what is for a node
    that is not it is lost (no peer).
    """
    options["nodes"] = options["nodes"] or (2 if medium in ("elrs", "sik") else 6)
    radio = chosen_radio(options["radio"], options["settings"]) if options["radio"] else None
    options["radio"] = radio
    if options["bitrate_bps"] is None:
        options["bitrate_bps"] = DEFAULT_BPS if radio is None else radio.bit_rate_bps
    try:
        results = _results(medium, options)
    except ValueError as error:
        raise BadInput(str(error)) from error
    if plot is not None:
        with writing(plot):
            _plot(results, plot)
    if as_json:
        click.echo(
            json.dumps({"medium": medium, "loads": [result.as_dict() for result in results]}, indent=2)
        )
    else:
        click.echo(_table(results))


def _results(medium: str, options: dict[str, Any]) -> list[Carried]:
    """What is carried at each load; says on stderr how far it is where that takes its time."""
    results, loads, told_s = [], _loads(medium, options), monotonic()
    for load_bps in loads:
        results.append(_result(medium, load_bps, options))
        if monotonic() - told_s > TELL_PERIOD_S and len(results) < len(loads):
            told_s = monotonic()
            click.echo(f"{len(results)} of {len(loads)} loads", err=True)
    return results


def _loads(medium: str, options: dict[str, Any]) -> Sequence[float]:
    if options["loads_bps"]:
        return options["loads_bps"]  # type: ignore[no-any-return]
    full_bps = options["bitrate_bps"]
    if medium == "csma":
        full_bps = _wifi(options).rate_mbps * 1e6
    elif medium == "elrs":
        full_bps = 8.0 * ELRS_MODES[options["mode"]].down_bytes_per_s
    elif medium == "sik":
        full_bps = 1e3 * options["air_kbps"]
    return [share * full_bps for share in CHOSEN_LOADS]


def _result(medium: str, load_bps: float, options: dict[str, Any]) -> Carried:
    to = 0 if options["to"] == "one" else None
    load = Load(load_bps, options["length_bytes"], to, options["duration_s"], options["seed"])
    return under_load(_medium(medium, options), load)


def _medium(medium: str, options: dict[str, Any]) -> AccessMedium:
    limits = QueueLimits(options["queue"])
    world, hearing, reach_ns = _world(options)
    if medium == "csma":
        settings = DcfSettings(
            rts_from_bytes=options["rts_from_bytes"],
            reach_ns=reach_ns,
            header_bytes=options["header_bytes"],
        )
        if options["radio"]:
            hearing = Hearing(
                hearing.preamble_mw, float(ratio_from_db(standard_energy_dbm(options["standard"])))
            )
        return Csma(
            world, _wifi(options), seed=options["seed"], settings=settings, limits=limits, hearing=hearing
        )
    if medium == "delay":
        return Delay(world, _lines(options), seed=options["seed"], limits=limits)
    if medium == "elrs":
        pairs = ElrsSettings(ELRS_MODES[options["mode"]], has_rc=options["rc"])
        return Elrs(world, pairs, seed=options["seed"])
    if medium == "sik":
        radios = SikSettings(
            options["air_kbps"], options["ecc"], framing=options["framing"], locked=not options["cold"]
        )
        return Sik(world, radios, seed=options["seed"], hearing=hearing)
    timing = BitRate(options["bitrate_bps"], header_bytes=options["header_bytes"])
    if medium == "airtime":
        return AirTime(world, timing, limits, hearing)
    guard_ns = int(1e6 * options["guard_ms"])
    slot_ms = options["slot_ms"]
    needed_ns = timing.duration_ns(options["length_bytes"]) + guard_ns
    slot_ns = needed_ns if slot_ms is None else int(1e6 * slot_ms)
    if slot_ns < needed_ns:
        raise ValueError(f"--slot-ms {slot_ms:g}: a packet takes {needed_ns / 1e6:g} ms, its guard included")
    return Tdma(world, timing, Schedule.equal(tuple(world.nodes), slot_ns, guard_ns), limits, hearing)


def _lines(options: dict[str, Any]) -> DelaySettings:
    least_ns, median_ns, most_ns = (int(1e6 * value_ms) for value_ms in options["delay_ms"])
    good_s, bad_s = options["outage_s"]
    return DelaySettings(
        WayDelay(least_ns, median_ns, most_ns),
        rate_bps=options["bitrate_bps"],
        header_bytes=options["header_bytes"],
        good_s=good_s,
        bad_s=bad_s,
        keeps_order=options["in_order"],
    )


def _wifi(options: dict[str, Any]) -> Wifi:
    standard, rate_mbps = STANDARDS[options["standard"]], options["rate_mbps"]
    lowest = 1.0 if options["standard"] == "11b" else 6.0
    return standard(rate_mbps or lowest, options["basic_rate_mbps"] or lowest)


def _world(options: dict[str, Any]) -> tuple[World, Hearing, int]:
    """Nodes and what lies between them, how plain radios hear there, and the longest way there and back, ns."""
    nodes = range(options["nodes"])
    if not options["radio"]:
        return PlainWorld(nodes), Hearing(), 0
    from channel.link.radio import Radio
    from channel.network.radio_world import RadioWorld

    ring_m, turn = options["ring_m"], 2.0 * pi / (len(nodes) - 1)
    places = {
        node: (ring_m * cos(turn * node), ring_m * sin(turn * node), -HEIGHT_M)
        if node
        else (0.0, 0.0, -HEIGHT_M)
        for node in nodes
    }
    world = RadioWorld(Radio(options["radio"]), places, options["seed"])
    return world, Hearing(world.noise_mw, world.noise_mw), 2 * world.longest_delay_ns


def _table(results: Sequence[Carried]) -> str:
    causes = sorted({loss for result in results for loss in result.lost})
    head = [
        "offered",
        "carried",
        "of all",
        "mean delay",
        "95 %",
        *(cause.value.replace("_", " ") for cause in causes),
    ]
    rows = [head]
    for result in results:
        mean, _, most = result.delay_s or (None, None, None)
        decided = max(result.sent - result.in_flight, 1)
        rows.append(
            [
                _rate(result.offered_bps),
                _rate(result.delivered_bps),
                f"{result.delivered / decided:.3f}",
                _ms(mean),
                _ms(most),
                *(f"{result.lost.get(cause, 0) / decided:.3f}" for cause in causes),
            ]
        )
    widths = [max(len(row[column]) for row in rows) for column in range(len(head))]
    return "\n".join(
        "  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)) for row in rows
    )


def _rate(bps: float) -> str:
    return f"{bps / 1e6:.3f} Mb/s" if bps >= 1e6 else f"{bps / 1e3:.2f} kb/s"


def _ms(seconds: float | None) -> str:
    return "-" if seconds is None else f"{1e3 * seconds:.2f} ms"


def _plot(results: Sequence[Carried], file: Path) -> None:
    from channel.cli.plots import axes_of

    figure, ((left, middle, right),) = axes_of(1, 3, (13.0, 4.0))
    offered = [result.offered_bps / 1e3 for result in results]
    left.plot(offered, [result.delivered_bps / 1e3 for result in results], marker="o")
    left.plot(offered, offered, color="0.7", ls="--")
    left.set(xlabel="offered [kb/s]", ylabel="carried to each receiver [kb/s]")
    for place, name in ((0, "mean"), (2, "95 %")):
        delays = [1e3 * result.delay_s[place] if result.delay_s else nan for result in results]
        middle.plot(offered, delays, marker="o", label=name)
    middle.set(xlabel="offered [kb/s]", ylabel="delay [ms]", yscale="log")
    middle.legend()
    for cause in sorted({loss for result in results for loss in result.lost}):
        shares = [result.lost.get(cause, 0) / max(result.sent - result.in_flight, 1) for result in results]
        right.plot(offered, shares, marker="o", label=cause.value.replace("_", " "))
    right.set(xlabel="offered [kb/s]", ylabel="share lost")
    if right.lines:
        right.legend()
    figure.savefig(file, dpi=120)
