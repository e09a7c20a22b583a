"""The numbers of a report: what its page shows and its JSON has."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict
from types import NoneType
from typing import Any, Final

import numpy as np

from bridge.record.names import as_seen_from
from bridge.record.tables.deliveries import Cause
from bridge.record.tables.truth import TRUTH
from bridge.run.directory import SUMMARY_FILE, name_in_utf8
from bridge.scenario.model import Scenario
from bridge.scenario.resolve.channel import fates_go_together
from bridge.scenario.resolve.radio import common_radio
from bridge.scenario.resolve.sensing import emitters_of
from channel.checks import ChannelInputError
from channel.validity import OutsideValidityError
from lostlink.compare.summary import mistakes_in_summary
from lostlink.flight.figure import model_curve
from lostlink.reading.ages import times_of
from lostlink.reading.air.capacity import Capacity
from lostlink.reading.lengths import median_payload_bytes, packets_by_length
from lostlink.reading.links.routes import on_air_ns, routes_of, routing_counts, ways_of
from lostlink.reading.positions import places_of, separation_m
from lostlink.reading.rows import Deliveries, RecordedDeliveries, on_network
from lostlink.reading.run import Run
from lostlink.report import packets
from lostlink.report.air_use import air_of
from lostlink.report.scales import plain
from lostlink.report.tracks import tracks_of

SCHEMA = 1
Content = dict[str, Any]
"""In JSON's types; docs/how-to/report.md has the keys."""
Tell = Callable[[str], object]
NUMBER: Final = (int, float)
KINDS: Final[dict[str, Any]] = {
    **dict.fromkeys(("unfinished", "bins", "checks", "unjudged", "expectations", "warnings"), list),
    **dict.fromkeys(("sim_duration_s", "wall_duration_s", "real_time_factor"), NUMBER),
    "refused": dict,
}
"""Of what a summary has, if it has it, as far as pages reckon with it; and of the rows of its lists:"""
KINDS_IN_ROWS: Final[dict[str, dict[str, Any]]] = {
    "bins": dict.fromkeys(("distance_min_m", "distance_max_m", "sent", "delivered"), NUMBER),
    "checks": {
        "name": str,
        "size": NUMBER,
        "found": (*NUMBER, NoneType),
        "power": (*NUMBER, NoneType),
        "chance": (*NUMBER, NoneType),
    },
    "unjudged": {"name": str, "why": str},
    "expectations": {"name": str, "passed": bool},
}
KILLED = "killed"
"""The ending of a run that has none."""


def content_of(run: Run, tell: Tell = lambda _step: None) -> Content:
    """All numbers of a report on a run, finished or killed.

    Args:
        run: the run.
        tell: called with what is done next.

    Raises:
        TableError, OSError, ValueError: a file of the run is damaged, or cannot be read.
    """
    _check_summary(run)
    tell("reads the deliveries")
    deliveries, end_ns = deliveries_of(run), run.end_ns
    times = times_of(deliveries)
    tell("counts packets")
    links = packets.links_of(deliveries, times, end_ns)
    found: Content = {
        "schema": SCHEMA,
        "run": _run(run),
        "provenance": asdict(run.provenance) if run.provenance else None,
    }
    networks = packets.networks_of(links)
    found |= {"totals": packets.totals_of(links), "networks": networks}
    found |= {"links": links, "losses": packets.losses_of(deliveries, end_ns)}
    tell("follows the ages of packets")
    found["ages"] = packets.ages_of(times, deliveries, end_ns)
    del times  # of the size of the record
    tell("sorts powers by distance")
    found["powers"] = packets.powers_of(deliveries)
    for network in networks:
        on = on_network(deliveries, network["radio"])
        is_only = len(networks) == 1
        network["losses"] = found["losses"] if is_only else packets.losses_of(on, end_ns)
        network["powers"] = found["powers"] if is_only else packets.powers_of(on)
    tell("computes its digests")
    found["run"]["summary_mistakes"] = mistakes_in_summary(run.path)
    tell("adds up the use of the air")
    found["air"] = air_of(deliveries, run.scenario, end_ns + run.scenario.tick_period_ns, on_air_ns(run.path))
    ways = ways_of(run.path, run.scenario.transceiver_ids)
    found |= {"routes": routes_of(deliveries, ways), "routing": routing_counts(run.path)}
    bins = run.summary.get("bins") or _bins_of_table(run.scenario, deliveries)
    found |= {"bins": bins, "model": _model(run.scenario, bins, deliveries)}
    tell("reads the true states")
    found |= tracks_of(run) | {"separation_min_m": least_separation_m(run)}
    result: Content = plain(found | _host(run, links) | _judgements(run))
    return result


def least_separation_m(run: Run) -> float | None:
    """How near two UA came to each other; None of fewer than two."""
    if not TRUTH.is_in(run.path):
        return None
    _, places = places_of(run.path, run.nodes)
    return separation_m(places[ua.node] for ua in run.scenario.ua)[0]


def deliveries_of(run: Run) -> RecordedDeliveries:
    """The deliveries of a run; no rows if it broke off before there were any."""
    scenario = run.scenario
    return RecordedDeliveries(run.path, scenario.transceiver_ids, scenario.network_names, may_lack=True)


def _check_summary(run: Run) -> None:
    """Refuse a summary that somebody has edited into what is none."""
    for name, kind in KINDS.items():
        value = run.summary.get(name)
        rows = value if isinstance(value, list) and name in KINDS_IN_ROWS else []
        if not (value is None or isinstance(value, kind)) or not all(_is_row(name, row) for row in rows):
            raise ValueError(f"{run.path / SUMMARY_FILE}: {name}: not what a run writes")


def _is_row(name: str, row: object) -> bool:
    kinds = KINDS_IN_ROWS[name].items()
    return isinstance(row, dict) and all(isinstance(row.get(key), kind) for key, kind in kinds)


def _run(run: Run) -> Content:
    scenario, summary = run.scenario, run.summary
    return {
        "name": name_in_utf8(run.path),
        "scenario": scenario.name,
        "description": scenario.description,
        "seed": scenario.seed,
        "autopilot": scenario.autopilots_in_words,
        "radio": as_seen_from(run.path, radio_name(scenario)),
        "radio_networks": scenario.network_names,
        "medium": Capacity.of(scenario).medium,
        "speed": scenario.speed,
        "tick_rate_hz": scenario.tick_rate_hz,
        "ending": run.ending or KILLED,
        "error": summary.get("error"),
        "unfinished": summary.get("unfinished") or [],
        "outcome": run.outcome,
        "verdict": run.verdict,
        "digest": run.digest,
        "redecided_from": summary.get("redecided_from"),
        "sim_duration_s": summary.get("sim_duration_s", run.end_ns / 1e9),
        "wall_duration_s": summary.get("wall_duration_s"),
        "real_time_factor": summary.get("real_time_factor"),
    }


def radio_name(scenario: Scenario) -> str:
    """What a scenario's radio is called in a line."""
    radio = scenario.radio
    name = radio if isinstance(radio, str) else f"{radio.get('preset', 'own radio')}, altered"
    own = [node.node for node in scenario.nodes if getattr(node, "radio", None) is not None]
    return f"{name}; node {', '.join(own)} with its own" if own else name


def _model(scenario: Scenario, bins: list[dict[str, Any]], deliveries: Deliveries) -> Content | None:
    """The model's curve over distance, if all nodes have one radio and it can be had here; else None.

    It is that of packets of their median length.
    """
    if not bins:
        return None
    farthest_m = max(row["distance_max_m"] for row in bins)
    with suppress(ValueError, OSError, ChannelInputError, OutsideValidityError):
        radio = common_radio(scenario, emitters_of(scenario))
        if radio is None:
            return None
        payload_bytes = median_payload_bytes(radio, packets_by_length(deliveries))
        distance_m, probability = model_curve(bins, radio, farthest_m, payload_bytes)
        return {"distance_m": np.asarray(distance_m), "probability_of_delivery": np.asarray(probability)}
    return None


def _bins_of_table(scenario: Scenario, deliveries: Deliveries) -> list[dict[str, Any]]:
    """The bins of a run without a ledger: whether fates of packets go together is that of its radios."""
    shared = True  # they may: a model of one's own may not be here
    with suppress(ValueError, OSError, ChannelInputError):
        shared = fates_go_together(scenario)
    return [row | {"shares_draws": shared} for row in packets.bins_of(deliveries)]


def _host(run: Run, links: Sequence[Mapping[str, Any]]) -> Content:
    """What the machine did to the run: packets it lost, by sender, and what was not accepted."""
    lost = Counter[str]()
    for link in links:
        lost[link["tx"]] += link["lost"].get(Cause.TRANSPORT, 0)
    reports = run.reports
    return {
        "host": {
            "lost": _not_zero(lost),
            "refused": _not_zero(run.summary.get("refused") or {}),
            "counters": reports.counters,
        },
        "events": [asdict(event) for event in reports.events],
        "may_not_repeat": list(reports.may_not_repeat),
    }


def _not_zero(counts: Mapping[str, int]) -> dict[str, int]:
    return {name: count for name, count in counts.items() if count}


def _judgements(run: Run) -> Content:
    return {name: run.summary.get(name) or [] for name in ("checks", "unjudged", "expectations", "warnings")}
