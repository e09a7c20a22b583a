"""Numbers of a report against rows counted by hand, and boxes against matplotlib's own."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from matplotlib.cbook import boxplot_stats

from channel.medium.reception import DELIVERED, ERASED
from lostlink.reading.ages import times_of
from lostlink.reading.rows import DeliveryRows, RecordedDeliveries
from lostlink.report.packets import ages_of, bins_of, links_of, losses_of, powers_of, totals_of
from lostlink.report.scales import nice_step, plain
from tests.unit.lostlink.replay.flown import flown, scenario_of

S = 1_000_000_000
NODES = ("0", "1", "gcs")


def rows_of(fate: list[int], distance_m: list[float], power_dbm: list[float]) -> DeliveryRows:
    """A packet a second from 0 to 1; its fate is 1 if it arrived."""
    count = len(fate)
    columns = {"tx": np.zeros(count, int), "rx": np.ones(count, int), "packets": np.ones(count, int)}
    columns |= {"fate": np.where(fate, DELIVERED, ERASED), "sim_time_ns": np.arange(count) * S}
    columns |= {"received_ns": np.arange(1, count + 1) * S}
    columns |= {"distance_m": np.array(distance_m), "received_power_dbm": np.array(power_dbm)}
    return DeliveryRows(NODES, columns)


def test_boxes_are_those_of_matplotlib():
    rng = np.random.default_rng(1)
    distance_m, power_dbm = rng.uniform(0, 118, 500), rng.normal(-80, 8, 500)
    found = powers_of(rows_of([1] * 500, list(distance_m), list(power_dbm)))
    assert found["width_m"] == 10.0
    for box in found["boxes"]:
        inside = (distance_m >= box["distance_min_m"]) & (distance_m < box["distance_max_m"])
        (want,) = boxplot_stats(power_dbm[inside])
        expected = [want[name] for name in ("whislo", "q1", "med", "q3", "whishi")]
        assert [box[name] for name in ("low", "q1", "median", "q3", "high")] == pytest.approx(expected)
        assert (box["packets"], box["without_power"]) == (inside.sum(), 0)


def test_packets_without_a_power_are_counted_and_left_out():
    nan = np.nan
    found = powers_of(rows_of([1, 1, 0, 0, 0], [5, 15, 15, 500, nan], [-50, -60, nan, nan, nan]))
    assert found["beyond"] == 1
    assert [(box["packets"], box["without_power"], box["median"]) for box in found["boxes"]] == [
        (1, 0, -50),
        (2, 1, -60),
    ]


def test_causes_over_time():
    found = plain(losses_of(rows_of([1, 0, 0, 1], [1] * 4, [-50] * 4), 4 * S))
    assert found["period_s"] == 0.1
    assert [found["delivered"][at] for at in (0, 10, 20, 30)] == [1, 0, 0, 1]
    assert [found["lost"]["channel_erasure"][at] for at in (0, 10, 20, 30)] == [0, 1, 1, 0]
    assert (sum(found["delivered"]), sum(found["lost"]["channel_erasure"])) == (2, 2)


def test_links_and_totals():
    rows = rows_of([1, 0, 0, 1], [1] * 4, [-50] * 4)
    (link,) = links = links_of(rows, times_of(rows), 5 * S)
    assert {name: link[name] for name in ("tx", "rx", "sent", "delivered", "delivery", "lost")} == {
        "tx": "0",
        "rx": "1",
        "sent": 4,
        "delivered": 2,
        "delivery": 0.5,
        "lost": {"channel_erasure": 2},
    }
    assert (link["latency_mean_s"], link["latency_max_s"]) == (1.0, 1.0)
    assert link["age_peak_s"] == 4.0  # the packet of 3 s comes at 4 s, until when the newest is of 0 s
    assert link["age_mean_s"] == pytest.approx((4 * 4 / 2 + 1.5) / 5)
    assert totals_of([*links, link])["delivered"] == 4
    assert totals_of([])["age_mean_s"] is None


def test_of_many_links_ages_are_the_median_and_the_oldest(tmp_path: Path):
    nodes = tuple("01234")
    run = flown(tmp_path / "run", scenario_of("moon2020", nodes), ticks=100)
    deliveries = RecordedDeliveries(run, nodes)
    times = times_of(deliveries)
    found = plain(ages_of(times, deliveries, 5 * S))
    median, oldest = found["series"]
    assert (median["name"], oldest["name"]) == ("median of 20 links", "the oldest of all")
    assert max(oldest["age_s"]) == pytest.approx(max(link.sawtooth(5 * S).age.peak_s for link in times))
    assert all(m <= o for m, o in zip(median["age_s"], oldest["age_s"], strict=True))


def test_bins_of_the_table_are_those_of_the_ledger(tmp_path: Path):
    run = flown(tmp_path / "run", scenario_of("moon2020", NODES), ticks=200)
    ledger = json.loads((run / "ledger.json").read_text())["bins"]
    keys = ("tx", "rx", "distance_min_m", "distance_max_m", "sent", "delivered", "measured")
    found = bins_of(RecordedDeliveries(run, NODES))
    assert [[row[key] for key in keys] for row in found] == [[row[key] for key in keys] for row in ledger]


@pytest.mark.parametrize(
    ("range_", "steps", "step"),
    [(720.0, 12, 60.0), (721.0, 12, 100.0), (0.0, 9, 10.0), (148.0, 150, 10.0)],
)
def test_steps_are_round(range_: float, steps: int, step: float):
    assert nice_step(range_, steps, 10.0) == pytest.approx(step)
