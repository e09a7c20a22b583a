"""What a run has to say in the end: `summary.json`, a table, a figure and one line of verdict."""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich import box
from rich.table import Table

from bridge.radio.deliveries import LEDGER
from bridge.record.digests import digest_line, digests
from bridge.record.events import read_reports
from bridge.run.directory import SUMMARY_FILE, RunDirectory
from bridge.scenario.model import Scenario
from channel.intervals import binomial_interval, proportion_interval
from channel.link.radio import Radio
from channel.validity import OutsideValidityError

SCHEMA = 2
FIGURE_FILE = "probability_of_delivery.png"
BIN_SENT_MIN = 50
"""Bins with fewer packets are shown, but not held against their interval."""
MARKERS = "os^vD<>Pp*"


@dataclass(frozen=True, slots=True)
class Timing:
    """How long a run took, from the first tick of sim time on."""

    sim_duration_s: float
    wall_duration_s: float

    @property
    def real_time_factor(self) -> float:
        """Sim time per wall time."""
        return self.sim_duration_s / self.wall_duration_s if self.wall_duration_s > 0 else 0.0


def summarise(
    scenario: Scenario,
    run: RunDirectory,
    timing: Timing,
    ending: str,
    unfinished: Sequence[str] = (),
    *,
    error: str | None = None,
) -> dict[str, Any]:
    """The content of `summary.json`; docs/run-output.md describes it.

    Raises:
        OSError, ValueError: if the router's ledger cannot be read.
    """
    ledger = _read_ledger(run, ending)
    judged = [row for row in ledger["bins"] if _is_judged(row)]
    within = sum(not _is_outside(row) for row in judged)
    found, reports = digests(run.path), read_reports(run.path)
    return {
        "schema": SCHEMA,
        "scenario": scenario.name,
        "seed": scenario.seed,
        "autopilot": scenario.autopilot,
        "radio": scenario.radio,
        "speed": scenario.speed,
        "ending": ending,
        "error": error,
        "unfinished": list(unfinished),
        "sim_duration_s": timing.sim_duration_s,
        "wall_duration_s": timing.wall_duration_s,
        "real_time_factor": timing.real_time_factor,
        "links": ledger["links"],
        "bins": ledger["bins"],
        "refused": ledger["refused"],
        "digest": digest_line(found),
        "digests": found,
        "may_not_repeat": list(reports.may_not_repeat),
        "events": [asdict(event) for event in reports.events],
        "counters": reports.counters,
        "bins_judged": len(judged),
        "bins_within": within,
        "checks": ledger["checks"],
        "verdict": _verdict(ledger["checks"], ledger["links"], ending) + _remark(unfinished),
    }


UNJUDGED = {"interrupted": "interrupted", "failed": "broke off"}
"""Endings after which nothing is judged, and how the verdict begins."""


def _read_ledger(run: RunDirectory, ending: str) -> dict[str, Any]:
    """What the router left; nothing if the run broke off before it could."""
    file = run.path / LEDGER
    if ending in UNJUDGED and not file.exists():
        return {"links": [], "bins": [], "refused": {}, "checks": []}
    ledger: dict[str, Any] = json.loads(file.read_text(encoding="ascii"))
    return ledger


def _verdict(checks: Sequence[dict[str, Any]], links: Sequence[dict[str, Any]], ending: str) -> str:
    sent, delivered = (sum(link[key] for link in links) for key in ("sent", "delivered"))
    counts = f"{delivered} of {sent} packets delivered"
    if ending in UNJUDGED:
        return f"{UNJUDGED[ending]}: {counts if links else 'no link was recorded'}"
    if not checks:
        return f"no verdict: {counts}; nothing was drawn"
    failed = [f"{check['name']} (chance {check['chance']:.2g})" for check in checks if not check["passed"]]
    if failed:
        return f"fail: {len(failed)} of {len(checks)} checks against the model: {', '.join(failed)}; {counts}"
    return f"pass: {len(checks)} checks of draws and powers against the model; {counts}"


def _remark(unfinished: Sequence[str]) -> str:
    return f"; node {', '.join(unfinished)} had not finished" if unfinished else ""


def write_summary(summary: dict[str, Any], run: RunDirectory) -> None:
    """Write `summary.json`."""
    (run.path / SUMMARY_FILE).write_text(json.dumps(summary, indent=1) + "\n", encoding="utf-8")


def bins_table(summary: dict[str, Any]) -> Table:
    """The table for people: a row per distance bin, all directed links taken together.

    A bin of a link that lies outside its own interval is marked in the last column.
    """
    table = Table(
        box=box.SIMPLE_HEAD, title="Probability of delivery by distance, all links", title_justify="left"
    )
    for name in ("distance, m", "sent", "delivered", "measured", "predicted", "99 % interval"):
        table.add_column(name, justify="right", no_wrap=True)
    if any(_is_outside(row) for row in summary["bins"]):
        table.add_column("outside", overflow="fold")
    starts = sorted({row["distance_min_m"] for row in summary["bins"]})
    for start_m in starts:
        rows = [row for row in summary["bins"] if row["distance_min_m"] == start_m]
        sent, delivered = (sum(row[key] for row in rows) for key in ("sent", "delivered"))
        predicted = min(1.0, sum(row["predicted"] * row["sent"] for row in rows) / sent)
        low, high = binomial_interval(sent, predicted)
        outside = [f"{row['tx']} -> {row['rx']}" for row in rows if _is_outside(row)]
        table.add_row(
            f"{start_m:.0f}-{rows[0]['distance_max_m']:.0f}",
            str(sent),
            str(delivered),
            f"{delivered / sent:.3f}",
            f"{predicted:.3f}",
            f"{low:.3f}-{high:.3f}",
            *([", ".join(outside)] if outside else []),
            style="red" if outside else ("" if sent >= BIN_SENT_MIN else "dim"),
        )
    return table


def _is_judged(row: dict[str, Any]) -> bool:
    return bool(row["sent"] >= BIN_SENT_MIN)


def _is_outside(row: dict[str, Any]) -> bool:
    return _is_judged(row) and not row["ci99"][0] <= row["measured"] <= row["ci99"][1]


def _model_curve(bins: list[dict[str, Any]], radio: Radio, farthest_m: float) -> tuple[Any, Any]:
    """The model by distance; where a distance alone says too little, what it predicted for the places of each bin."""
    distance_m = np.linspace(1.0, farthest_m, 600)
    with suppress(OutsideValidityError):
        if not getattr(radio.config.propagation, "needs_places", False):
            return distance_m, radio.probability_of_delivery(distance_m)
    points = sorted((_middle(row), row["predicted"]) for row in bins)
    return [middle for middle, _ in points], [predicted for _, predicted in points]


def draw_probability_of_delivery(summary: dict[str, Any], radio: Radio | None, path: Path) -> None:
    """Measured probability of delivery over the model's curve, if all nodes have one radio; as Moon et al., Fig. 6."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(figsize=(8, 4.5), layout="constrained")
    farthest_m = max((row["distance_max_m"] for row in summary["bins"]), default=100.0)
    if radio is not None:
        distance_m, closed = _model_curve(summary["bins"], radio, farthest_m)
        axes.plot(distance_m, closed, color="0.3", label="model", zorder=1)
    links = sorted({(row["tx"], row["rx"]) for row in summary["bins"]})
    for index, (tx, rx) in enumerate(links):
        aside_m = 3.0 * (index - (len(links) - 1) / 2) / max(1, len(links) - 1)
        rows = [row for row in summary["bins"] if (row["tx"], row["rx"]) == (tx, rx)]
        centre_m, measured = (
            np.array([_middle(r) for r in rows]) + aside_m,
            np.array([r["measured"] for r in rows]),
        )
        low, high = proportion_interval([r["delivered"] for r in rows], [r["sent"] for r in rows])
        error = np.maximum([measured - low, high - measured], 0.0)
        axes.errorbar(
            centre_m,
            measured,
            error,
            fmt=MARKERS[index % len(MARKERS)],
            markersize=4,
            capsize=2,
            lw=1,
            label=f"{tx} to {rx}",
        )
    axes.set(xlabel="distance, m", ylabel="probability of delivery", ylim=(-0.03, 1.03), xlim=(0, farthest_m))
    radio_name = summary["radio"]
    if not isinstance(radio_name, str):
        radio_name = radio_name.get("preset", "own radio")
    name = Path(radio_name).stem
    axes.set_title(
        f"{summary['scenario']}: {name}, seed {summary['seed']} (measured with 99 % binomial intervals)"
    )
    axes.grid(alpha=0.3)
    axes.legend()
    figure.savefig(path, dpi=120)
    plt.close(figure)


def _middle(row: dict[str, Any]) -> float:
    return float(row["distance_min_m"] + row["distance_max_m"]) / 2
