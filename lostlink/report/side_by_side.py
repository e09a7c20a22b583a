"""Runs side by side: settings in which they differ, and what came of each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from bridge.bus.keys import MAIN
from bridge.record.names import as_seen_from
from bridge.record.provenance import made_by, version_noted
from lostlink.compare.summary import mistakes_in_summary
from lostlink.reading.ages import times_of
from lostlink.reading.run import Run
from lostlink.report import packets
from lostlink.report.content import KILLED, deliveries_of, least_separation_m
from lostlink.report.page.page import render
from lostlink.report.page.words import NOTHING, num, share
from lostlink.report.pictures.radio import draw_comparison
from lostlink.report.scales import plain

SCHEMA = 1
NOT_SETTINGS = ("ports", "hosts", "processes", "zenoh", "figure", "description", "name")
"""Keys of a scenario that say nothing of what is flown."""
SETTINGS_MAX = 30
LINKS_MAX = 20
"""Of more links than this a table has those in which the runs differ most."""
FIGURES = {
    "sent": "packets sent",
    "delivered": "packets delivered",
    "delivery": "share delivered",
    "age_mean_s": "mean age of information, s",
    "age_p95_s": "age of the worst link, 95 %, s",
    "age_peak_s": "greatest age, s",
    "latency_max_s": "greatest latency, s",
}
"""Of each radio network."""
Content = dict[str, Any]
Row = tuple[str, list[str], bool]
"""What, its value in each run, and whether they differ."""


def side_by_side(runs: Sequence[Run], tell: Callable[[str], object] = lambda _step: None) -> Content:
    """The numbers of several runs: docs/how-to/report.md has the keys.

    Args:
        runs: finished or killed.
        tell: called with what is read next.

    Raises:
        TableError, OSError, ValueError: a file of a run is damaged, or cannot be read.
    """
    columns = []
    for run in runs:
        tell(f"reads {run.path.name}")
        columns.append(_column(run))
    for name, column in zip(_names(runs), columns, strict=True):
        column["name"] = name
    for column in columns:
        is_known = column["digest"] and not column["summary_mistakes"]
        same = (other["name"] for other in columns if other["digest"] == column["digest"])
        column["same_as"] = next(same, None) if is_known else None
    result: Content = plain({"schema": SCHEMA, "runs": columns, "settings": settings_of(runs)})
    return result


def _names(runs: Sequence[Run]) -> list[str]:
    names = [run.path.name for run in runs]
    return names if len(set(names)) == len(names) else [str(run.path) for run in runs]


def _column(run: Run) -> Content:
    with version_noted(run.path):
        return _measured(run)


def _measured(run: Run) -> Content:
    deliveries, end_ns, summary = deliveries_of(run), run.end_ns, run.summary
    links = packets.links_of(deliveries, times_of(deliveries), end_ns)
    bins = packets.bins_of(deliveries)
    return {
        "name": "",
        "scenario": run.scenario.name,
        "seed": run.scenario.seed,
        "radio_networks": run.scenario.network_names,
        "made_by": made_by(run.path),
        "ending": run.ending or KILLED,
        "outcome": run.outcome,
        "verdict": run.verdict,
        "expectations_failed": [e["name"] for e in summary.get("expectations") or [] if not e["passed"]],
        "digest": run.digest,
        "summary_mistakes": mistakes_in_summary(run.path),
        "sim_duration_s": summary.get("sim_duration_s", end_ns / 1e9),
        **packets.totals_of(links),
        "separation_min_m": least_separation_m(run),
        "links": links,
        "delivery_by_distance": _by_distance(bins),
        "networks": [
            each
            | {"delivery_by_distance": _by_distance([row for row in bins if row["radio"] == each["radio"]])}
            for each in packets.networks_of(links)
        ],
    }


def _by_distance(bins: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """All links together."""
    found: dict[float, dict[str, Any]] = {}
    for row in bins:
        edges = {name: row[name] for name in ("distance_min_m", "distance_max_m")}
        total = found.setdefault(row["distance_min_m"], edges | {"sent": 0, "delivered": 0})
        total["sent"] += row["sent"]
        total["delivered"] += row["delivered"]
    return [found[each] for each in sorted(found)]


def settings_of(runs: Sequence[Run]) -> dict[str, list[Any]]:
    """Keys of the scenarios, dotted, with a value per run: those that are not the same in all.

    Of nodes that are not in all runs there is one row: how many nodes each run has; or, where runs have as many and
    others, which (``nodes.id``).
    """
    flat = [_settings(run) for run in runs]
    ids = [tuple(node.node for node in run.scenario.nodes) for run in runs]
    common = set(ids[0]).intersection(*ids)
    keys = [key for key in dict.fromkeys(key for each in flat for key in each) if _is_told(key, common)]
    values: dict[str, list[Any]] = {"nodes": [len(each) for each in ids]}
    if len(set(map(frozenset, ids))) > len(set(map(len, ids))):
        values["nodes.id"] = [", ".join(node for node in each if node not in common) for each in ids]
    values |= {key: [each.get(key) for each in flat] for key in keys}
    return {key: each for key, each in values.items() if any(value != each[0] for value in each)}


def _settings(run: Run) -> dict[str, Any]:
    """Dotted; a radio that the run carries is that in its directory, wherever it lies."""
    flat = _flat(run.scenario.model_dump(mode="json", by_alias=True))
    return {key: as_seen_from(run.path, v) if isinstance(v, str) else v for key, v in flat.items()}


def _is_told(key: str, common: set[str]) -> bool:
    first, _, rest = key.partition(".")
    return first not in NOT_SETTINGS and (first != "nodes" or rest.partition(".")[0] in common)


def _flat(content: Any, at: str = "") -> dict[str, Any]:
    """Leaves by dotted key; nodes by their ids, as `--set` names them."""
    if (
        isinstance(content, list)
        and content
        and all(isinstance(each, dict) and "id" in each for each in content)
    ):
        content = {str(each["id"]): each for each in content}
    if not isinstance(content, dict) or not content:
        return {at: content}
    found: dict[str, Any] = {}
    for key, value in content.items():
        found |= _flat(value, f"{at}.{key}" if at else str(key))
    return found


def table_of(content: Content) -> list[Row]:
    """The rows of a table of the runs, as people read them."""
    runs = content["runs"]
    rows = [
        _row("scenario", [run["scenario"] for run in runs]),
        _row("seed", [str(run["seed"]) for run in runs]),
    ]
    made = _row("made by", [run["made_by"] for run in runs])
    rows += [made] if made[2] else []
    told = [
        (key, values) for key, values in content["settings"].items() if key not in ("seed", "expectations")
    ]
    rows += [_row(key, [_setting(value) for value in values]) for key, values in told[:SETTINGS_MAX]]
    if len(told) > SETTINGS_MAX:
        rows.append((f"{len(told) - SETTINGS_MAX} more settings: see the JSON", [""] * len(runs), False))
    rows += [
        _row("ending", [run["ending"] for run in runs]),
        _row("outcome", [run["outcome"].replace("_", " ") or NOTHING for run in runs]),
        _row("failed expectations", [", ".join(run["expectations_failed"]) or "none" for run in runs]),
    ]
    networks = list(dict.fromkeys(each["radio"] for run in runs for each in run["networks"])) or [MAIN]
    is_only = len({radio for run in runs for radio in run["radio_networks"]}) == 1
    rows.append(_figure("sim time, s", "sim_duration_s", runs))
    for radio in networks:
        on = "" if is_only else f"{radio}: "
        of = [_on_network(run, radio) for run in runs]
        rows += [_figure(f"{on}{name}", key, of) for key, name in FIGURES.items()]
    rows.append(_figure("least distance of two UA, m", "separation_min_m", runs))
    rows += _link_rows(runs, is_only=is_only)
    rows.append(_row("digest", [run["digest"][:12] or NOTHING for run in runs]))
    return rows


def _on_network(run: Content, radio: str) -> Content:
    """What came of the packets of a run on a radio network, of which it may have none."""
    return next((each for each in run["networks"] if each["radio"] == radio), packets.totals_of([]))


def _figure(name: str, key: str, of: Sequence[Content]) -> Row:
    return _row(name, [share(each[key]) if key == "delivery" else num(each[key]) for each in of])


def _row(name: str, cells: list[str]) -> Row:
    return name, cells, len(set(cells)) > 1


def _setting(value: Any) -> str:
    return NOTHING if value is None else f"{value:.10g}" if isinstance(value, float) else str(value)


def _link_rows(runs: list[dict[str, Any]], *, is_only: bool) -> list[Row]:
    by_run = [
        {(link["radio"], link["tx"], link["rx"]): link["delivery"] for link in run["links"]} for run in runs
    ]
    links = list(dict.fromkeys(link for each in by_run for link in each))
    left_out = len(links) - LINKS_MAX
    if left_out > 0:
        links = sorted(links, key=lambda link: -_spread([each.get(link) for each in by_run]))[:LINKS_MAX]
    rows = [
        _row(
            f"delivery {packets.link_name(tx, rx, radio, is_only=is_only)}",
            [share(each.get((radio, tx, rx))) for each in by_run],
        )
        for radio, tx, rx in links
    ]
    if left_out > 0:
        rows.append(
            (f"{left_out} more links, which differ no more than these: see the JSON", [""] * len(runs), False)
        )
    return rows


def _spread(shares: list[float | None]) -> float:
    known = [each for each in shares if each is not None]
    return max(known) - min(known) if known else 0.0


def sameness(content: Content) -> str:
    """Which runs are the same in all that repeats, and of which that cannot be said."""
    forged = [run["name"] for run in content["runs"] if run["summary_mistakes"]]
    runs = [run for run in content["runs"] if not run["summary_mistakes"]]
    if forged:
        rest = f" {_sameness(runs)}" if len(runs) > 1 else ""
        return f"The summary of {' and of '.join(forged)} is not that of its record.{rest}"
    return _sameness(runs)


def _sameness(runs: list[dict[str, Any]]) -> str:
    groups: dict[str, list[str]] = {}
    for run in runs:
        if run["digest"]:
            groups.setdefault(run["digest"], []).append(run["name"])
    if len(groups) == 1 and all(run["digest"] for run in runs):
        return "All digests are equal: these runs are identical in all that repeats."
    equal = [" and ".join(names) for names in groups.values() if len(names) > 1]
    if equal:
        return f"Equal digests: {'; '.join(equal)}. The others differ."
    return "No two of these runs have the same digest."


def comparison_page(content: Content) -> str:
    """The runs as one page that asks for nothing."""
    has_any = any(run["delivery_by_distance"] for run in content["runs"])
    pictures = {"comparison": draw_comparison(content["runs"])} if has_any else {}
    return render("compare.html.j2", pictures, c=content, rows=table_of(content), same=sameness(content))
