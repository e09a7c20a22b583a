"""What a run has to say in the end: `summary.json`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from bridge.radio.ledger_file import BINS_OF_TRANSMISSIONS, LEDGER
from bridge.record.autopilot_logs import autopilot_logs
from bridge.record.digests import digest_line, digests
from bridge.record.events import AGENT_BLOCKED, PROCESS_LEFT, WHOSE, Reports, read_reports
from bridge.record.tables.deliveries import DELIVERIES
from bridge.record.tables.schema import TableError
from bridge.run.directory import SUMMARY_FILE, RunDirectory
from bridge.run.json_object import read_object, write_object
from bridge.scenario.model import Scenario
from bridge.scenario.nodes import MAIN
from bridge.scenario.resolve.radio import config_of
from channel.medium.judge.check import BASE_LOSS
from fdm.clock.events import EventKind
from lostlink.expectations.judge import Judgement, judge
from lostlink.flight.crashes import crashes
from lostlink.flight.full_modems import full_modems
from lostlink.flight.parameters import unknown_parameters
from lostlink.flight.under_ground import under_ground
from lostlink.flight.verdict import UNJUDGED, verdict_of
from lostlink.plan.radios.held import held_back
from lostlink.reading.air.account import AirAccount, tallies_of
from lostlink.reading.air.use import NS_PER_S
from lostlink.reading.links.counts import link_counts
from lostlink.reading.links.routes import on_air_ns
from lostlink.reading.rows import RecordedDeliveries

SCHEMA = 3
NOT_COUNTED = "the radio has one, and no packet was counted"
"""Why a base loss is not judged of which the ledger says nothing."""
BIN_SENT_MIN = 50
"""Bins with fewer packets are shown, but not held against their interval."""


@dataclass(frozen=True, slots=True)
class Timing:
    """How long a run took: sim time of its last tick, and wall time from its first tick after 0 to the last.

    At 0 it may wait for long, for an autopilot that somebody starts.
    """

    sim_duration_s: float
    wall_duration_s: float
    first_tick_s: float = 0.0
    """Sim time from which the wall time counts."""

    @property
    def real_time_factor(self) -> float:
        """Sim time per wall time."""
        sim_s = self.sim_duration_s - self.first_tick_s
        return sim_s / self.wall_duration_s if self.wall_duration_s > 0 else 0.0


class TickWatch:
    """When ticks came, by wall time."""

    def __init__(self) -> None:
        self._first: tuple[int, float] | None = None
        self._latest_s = 0.0

    def tick(self, sim_time_ns: int, now_s: float) -> None:
        """A tick came."""
        self._latest_s = now_s
        if self._first is None and sim_time_ns > 0:
            self._first = sim_time_ns, now_s

    def timing(self, sim_time_ns: int) -> Timing:
        """Of a run whose last tick is at ``sim_time_ns``."""
        first_ns, first_s = self._first or (0, self._latest_s)
        return Timing(sim_time_ns / NS_PER_S, self._latest_s - first_s, first_ns / NS_PER_S)


def summarise(
    scenario: Scenario,
    run: RunDirectory,
    timing: Timing,
    ending: str,
    unfinished: Sequence[str] = (),
    *,
    error: str | None = None,
) -> dict[str, Any]:
    """The content of `summary.json`; docs/reference/run-output.md describes it.

    Raises:
        OSError, ValueError: if the router's ledger cannot be read.
    """
    ledger = _read_ledger(run, ending)
    ledger["unjudged"] += _base_losses_not_counted(scenario, ledger)
    judged = [row for row in ledger["bins"] if is_judged(row)]
    within = sum(not is_outside(row) for row in judged)
    found, reports = digests(run.path), read_reports(run.path)
    judgements = judge(run.path, scenario, ending, as_far_as_possible=True)
    air = _air(scenario, run, timing)
    verdict = verdict_of(
        ledger["checks"],
        ledger["links"],
        ending,
        judgements,
        unfinished,
        ledger["unjudged"],
        [account.remark for account in air],
        error=error,
    )
    return {
        "schema": SCHEMA,
        "scenario": scenario.name,
        "seed": scenario.seed,
        "autopilot": scenario.autopilots_in_words,
        "radio": scenario.radio,
        "speed": scenario.speed,
        "ending": ending,
        "error": error,
        "unfinished": list(unfinished),
        "sim_duration_s": timing.sim_duration_s,
        "wall_duration_s": timing.wall_duration_s,
        "real_time_factor": timing.real_time_factor,
        **{key: ledger[key] for key in ("links", "bins", "refused")},
        "air": [account.plain for account in air],
        "warnings": _air_warnings(scenario, air) + _warnings(scenario, run, reports),
        "digest": digest_line(found),
        "digests": found,
        "may_not_repeat": list(reports.may_not_repeat),
        "events": [asdict(event) for event in reports.events],
        "counters": reports.counters,
        "autopilot_logs": autopilot_logs(run.path),
        "bins_judged": len(judged),
        "bins_within": within,
        **{key: ledger[key] for key in ("checks", "unjudged")},
        "expectations": [asdict(judgement) for judgement in judgements],
        "outcome": verdict.outcome,
        "verdict": verdict.text,
    }


def _air_warnings(scenario: Scenario, air: Sequence[AirAccount]) -> list[str]:
    """What was likely not meant with the air, and why packets may have waited."""
    lines = [text for account in air for text in account.warnings]
    return [*lines, *held_back(scenario, [account.radio for account in air if account.lost_waiting])]


def _warnings(scenario: Scenario, run: RunDirectory, reports: Reports) -> list[str]:
    """What its nodes and autopilots reported that somebody must see, but for what is of wall time."""
    told = [
        f"{WHOSE[event.kind]}{scenario.title(event.node)}: {event.text}"
        for event in reports.events
        if event.kind in WHOSE and event.kind != AGENT_BLOCKED
    ]
    told += [event.text for event in reports.events if event.kind == PROCESS_LEFT]
    told += [
        f"{scenario.title(event.node)}: its flight model diverged at {event.sim_time_ns / NS_PER_S:g} s: {event.text}"
        for event in reports.events
        if event.kind == EventKind.DIVERGED.value
    ]
    flown = (*unknown_parameters(scenario, run), *under_ground(scenario, run), *crashes(scenario, run))
    return [*told, *full_modems(scenario, reports), *flown]


def expectation_lines(summary: dict[str, Any]) -> list[str]:
    """A line for people per expectation of the run."""
    return [str(Judgement(**row)) for row in summary["expectations"]]


def _read_ledger(run: RunDirectory, ending: str) -> dict[str, Any]:
    """What the router left; if the run broke off before it could, the links that are in the tables."""
    file = run.path / LEDGER
    if ending in UNJUDGED and not file.exists():
        return {"links": _recorded_links(run), "bins": [], "refused": {}, "checks": [], "unjudged": []}
    return read_object(file, "damaged")


def _base_losses_not_counted(scenario: Scenario, ledger: dict[str, Any]) -> list[dict[str, Any]]:
    """Networks whose radio has a base loss of which the run says nothing, though it drew something.

    Code of agents that shares a process with the radio can take it away, and the check with it.
    """
    told = {item["name"] for item in (*ledger["checks"], *ledger["unjudged"])}
    own = [node.radio for node in scenario.transceivers if node.radio is not None]
    radios = {MAIN: [scenario.radio, *own]} | {name: [radio] for name, radio in scenario.networks.items()}
    names = {
        f"{network}: {BASE_LOSS}" if len(radios) > 1 else BASE_LOSS
        for network, each in radios.items()
        if any(config_of(radio).base_loss > 0.0 for radio in each)
    }
    return [{"name": name, "why": NOT_COUNTED} for name in sorted(names - told) if ledger["checks"]]


def _recorded_links(run: RunDirectory) -> list[dict[str, Any]]:
    """What became of each link's packets by the table of deliveries; nothing if that cannot be read."""
    if not DELIVERIES.is_in(run.path):
        return []
    try:
        columns = link_counts(run.path, run.scenario.transceiver_ids, run.scenario.network_names)
    except (OSError, TableError):
        return []  # why it cannot be read is reported where it should have become Parquet
    rows = [
        dict(zip(columns, row, strict=True))
        for row in zip(*(c.tolist() for c in columns.values()), strict=True)
    ]
    ends = ("radio", "tx", "rx", "sent", "delivered")
    return [
        {name: row[name] for name in ends}
        | {"lost": {name: n for name, n in row.items() if name not in ends and n}}
        for row in rows
    ]


def _air(scenario: Scenario, run: RunDirectory, timing: Timing) -> list[AirAccount]:
    """The account of each network; none if there are no deliveries, or they cannot be read."""
    try:
        tallies = tallies_of(RecordedDeliveries(run.path, scenario.transceiver_ids, may_lack=True), scenario)
    except (OSError, TableError):
        return []  # why it cannot be read is reported where it should have become Parquet
    end_ns = round(timing.sim_duration_s * NS_PER_S) + scenario.tick_period_ns
    on_air = on_air_ns(run.path) if tallies else {}
    return [tally.account(end_ns, on_air.get(tally.capacity.network)) for tally in tallies]


def write_summary(summary: dict[str, Any], run: RunDirectory) -> None:
    """Write `summary.json`.

    Raises:
        OSError: it cannot be written; there is none then.
    """
    write_object(run.path / SUMMARY_FILE, summary)


def is_judged(row: dict[str, Any]) -> bool:
    """Whether a bin has an interval, and packets enough to be held against it."""
    return bool(row["sent"] >= BIN_SENT_MIN) and row["ci99"] is not None


def shares_draws(bins: Sequence[dict[str, Any]]) -> bool:
    """Whether packets shared what was drawn, so that no interval of independent ones holds for their ratios."""
    return any(
        row.get("shares_draws") or (row["ci99"] is None and row["predicted"] is not None) for row in bins
    )


def networks_of_bins(bins: Sequence[dict[str, Any]]) -> dict[str, list[dict[str, Any]]]:
    """By radio network, in the order of the bins; runs of before do not name it, nor does a table's row."""
    found: dict[str, list[dict[str, Any]]] = {}
    for row in bins:
        found.setdefault(row.get("radio", MAIN), []).append(row)
    return found


def of_transmissions(bins: Sequence[dict[str, Any]]) -> bool:
    """Whether there are bins of first transmissions, each as if alone on the air, in place of packets."""
    return any(row.get("of") == BINS_OF_TRANSMISSIONS for row in bins)  # runs of before do not say


def is_outside(row: dict[str, Any]) -> bool:
    """Whether a bin that is judged lies outside its interval."""
    return is_judged(row) and not row["ci99"][0] <= row["measured"] <= row["ci99"][1]
