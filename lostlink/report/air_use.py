"""The use of the air over time, as a report has it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from bridge.scenario.model import Scenario
from lostlink.reading.air.account import AirTally, tallies_of
from lostlink.reading.air.use import NS_PER_S, edges_of
from lostlink.reading.rows import Deliveries
from lostlink.report.packets import period_of

PERIOD_LEAST_NS: Final = 1_000_000_000
"""Below this what agents send at every tick, or second, would be seen as peaks."""


def air_of(
    deliveries: Deliveries, scenario: Scenario, end_ns: int, on_air_ns: Mapping[str, int]
) -> list[dict[str, Any]]:
    """Of each network its account as in `summary.json`, its ``warning``, and ``series``.

    Series are by ``sim_time_s``, begins of periods, the last of which ends at ``end_s``: ``offered_share`` and, where
    packets take time, ``use_share``, ``wait_p50_s``, ``wait_p95_s``, ``delay_p50_s``, ``delay_p95_s``; else these are
    null. Where nodes hand packets on ``use_share`` is null, and ``on_air_ns`` has the sum by network.
    """
    return [
        _of_network(tally, end_ns, on_air_ns.get(tally.capacity.network))
        for tally in tallies_of(deliveries, scenario)
    ]


def _of_network(tally: AirTally, end_ns: int, on_air_ns: int | None) -> dict[str, Any]:
    account, edges_ns = (
        tally.account(end_ns, on_air_ns),
        edges_of(end_ns, max(period_of(end_ns), PERIOD_LEAST_NS)),
    )
    series: dict[str, Any] = {"offered_share": tally.offered.shares(edges_ns)}
    series |= dict.fromkeys(("use_share", "wait_p50_s", "wait_p95_s", "delay_p50_s", "delay_p95_s"))
    if tally.capacity.takes_time:
        series["use_share"] = tally.frames.use(edges_ns) if on_air_ns is None else None
        series["wait_p50_s"], series["wait_p95_s"] = tally.frames.waits(edges_ns)
        series["delay_p50_s"], series["delay_p95_s"] = tally.delays.over_time(edges_ns)
    times = {"sim_time_s": edges_ns[:-1] / NS_PER_S, "end_s": end_ns / NS_PER_S}
    return {**account.plain, "warning": "; ".join(account.warnings), **times, "series": series}
