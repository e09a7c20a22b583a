"""What is kept of links: series, shares over a window, counts by distance, and no more than there is room for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bridge.bus.messages import Header, Links
from channel.medium.stations.partitions import Partition, Partitions
from lostlink.view.picture import link_history
from lostlink.view.picture.link_history import BIN_WIDTH_M, FIGURES, WINDOW, LinkHistory
from tests.unit.lostlink.view.fleet import links


def test_a_series_has_what_the_reports_said() -> None:
    history = LinkHistory(2)
    for number in range(5):
        history.take(links(0.2 * number, 10.0 * number, 0.25, 4 * number, 3 * number))
    series = history.series(0, 1)
    assert series.time_s == pytest.approx([0.0, 0.2, 0.4, 0.6, 0.8])
    assert series.distance_m == pytest.approx([0.0, 10.0, 20.0, 30.0, 40.0])
    assert series.received_power_dbm == pytest.approx([-80.0] * 5)
    assert series.measured[1:] == pytest.approx([0.75] * 4)
    assert series.probability[1:] == pytest.approx([0.75] * 4)
    assert np.isnan(series.measured[0])
    assert np.isnan(history.series(1, 0).distance_m).all()


def test_the_measured_share_is_that_of_the_last_reports() -> None:
    history = LinkHistory(2)
    for number in range(2 * WINDOW + 1):
        delivered = min(number, WINDOW)  # from the middle on nothing arrives
        history.take(links(0.2 * number, 50.0, 0.0, number, delivered))
    measured = history.series(0, 1).measured
    assert measured[WINDOW] == pytest.approx(1.0)
    assert measured[WINDOW + WINDOW // 2] == pytest.approx(0.5)
    assert measured[2 * WINDOW] == pytest.approx(0.0)


def test_packets_are_counted_where_the_link_was() -> None:
    history = LinkHistory(2)
    history.take(links(0.2, 5.0, 0.0, 4, 4))
    history.take(links(0.4, 25.0, 0.0, 8, 7))
    history.take(links(0.6, 26.0, 0.0, 12, 9))
    bins = history.by_distance()
    assert bins.distance_m.tolist() == [BIN_WIDTH_M / 2, 1.5 * BIN_WIDTH_M]
    assert bins.sent.tolist() == [4, 8]
    assert bins.delivered.tolist() == [4, 5]


def test_packets_that_never_were_on_the_air_are_counted_where_the_link_was_last() -> None:
    """Those of a queue that is full; while a radio is off nothing is measured."""
    history = LinkHistory(2)
    history.take(links(0.2, 25.0, 0.0, 4, 4))
    history.take(links(0.4, np.nan, np.nan, 8, 5))
    history.take(replace(links(0.6, np.nan, np.nan, 12, 5), radio_off=(1,)))
    history.take(links(0.8, 45.0, 0.0, 16, 7))  # two before the radio was on again
    history.take(links(1.0, 45.0, 0.0, 20, 11))
    bins = history.by_distance()
    assert bins.distance_m.tolist() == [1.5 * BIN_WIDTH_M, 2.5 * BIN_WIDTH_M]
    assert bins.sent.tolist() == [8, 4]
    assert bins.delivered.tolist() == [5, 4]


def test_while_a_partition_is_between_two_nodes_nothing_is_measured() -> None:
    parts = Partitions(["0", "1"], [Partition([["0"], ["1"]], 500_000_000, 700_000_000)])
    history = LinkHistory(2, partitions=parts)
    history.take(links(0.2, 25.0, 0.0, 4, 4))
    history.take(links(0.4, 25.0, 0.0, 8, 8))
    history.take(links(0.6, np.nan, np.nan, 12, 10))
    assert np.isnan(history.probability[0, 1])
    history.take(links(0.8, 45.0, 0.0, 16, 12))  # two before the partition was over
    history.take(links(1.0, 45.0, 0.0, 20, 16))
    bins = history.by_distance()
    assert bins.distance_m.tolist() == [1.5 * BIN_WIDTH_M, 2.5 * BIN_WIDTH_M]
    assert bins.sent.tolist() == [8, 4]
    assert bins.delivered.tolist() == [8, 4]


def test_packets_from_before_somebody_looked_are_counted_nowhere() -> None:
    history = LinkHistory(2)
    history.take(links(100.0, 400.0, 0.0, 2000, 1500))
    history.take(links(100.2, 402.0, 0.0, 2004, 1502))
    bins = history.by_distance()
    assert bins.sent.tolist() == [4]
    assert bins.delivered.tolist() == [2]


def test_a_link_turns_as_its_probability_falls_and_one_deep_fade_does_not_turn_it() -> None:
    history = LinkHistory(2)
    for number in range(20):
        history.take(links(0.2 * number, 10.0, 0.0, number, number))
    history.take(links(4.0, 10.0, 1.0, 20, 20))
    assert 0.7 < history.probability[0, 1] < 0.9
    for number in range(20):
        history.take(links(4.2 + 0.2 * number, 10.0, 1.0, 21, 20))
    assert history.probability[0, 1] < 0.02


def test_memory_is_bounded_and_the_whole_run_stays_in_sight(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(link_history, "REPORTS_MAX", 64)
    history = LinkHistory(2)
    for number in range(1000):
        history.take(links(0.2 * number, 10.0, 0.0, number, number))
    series = history.series(0, 1)
    assert len(series.time_s) <= 64
    assert series.time_s[0] < 20.0
    assert series.time_s[-1] > 190.0


def test_memory_of_a_large_fleet_is_bounded_by_its_numbers() -> None:
    history = LinkHistory(3, values_max=10 * LinkHistory(3).latest("per").size * len(FIGURES))
    for number in range(200):
        history.take(links(0.2 * number, 10.0, 0.0, number, number))
    series = history.series(0, 1)
    assert 4 < len(series.time_s) <= 10
    assert series.time_s[-1] > 30.0


def test_a_distance_beyond_all_bins_is_in_the_last() -> None:
    history = LinkHistory(2)
    history.take(links(0.2, 1e9, 0.0, 4, 4))
    assert history.by_distance().sent.tolist() == [4]


def test_a_report_without_links_is_one() -> None:
    history = LinkHistory(2)
    history.take(Links(Header.at(0, ""), ("0", "1")))
    assert history.reports == 1
    assert np.nonzero(history.carried)[0].size == 0


def test_the_model_of_a_link_is_the_mean_of_the_packets_that_have_one() -> None:
    """A packet that never was on the air has no PER: its radio was off, or its queue full."""
    history = LinkHistory(2)
    for number in range(2 * WINDOW):
        per = 0.2 if number % 2 and number < WINDOW else np.nan
        history.take(links(0.2 * number, 50.0, per, number, 0))
    probability = history.series(0, 1).probability
    assert np.isnan(probability[0])
    assert probability[1 : 2 * WINDOW - 1] == pytest.approx(0.8)
    assert np.isnan(probability[-1])
    assert np.isnan(history.series(1, 0).probability).all()


def test_the_recent_probability_of_a_link_stays_while_its_queue_is_full_and_begins_anew_with_its_radio() -> (
    None
):
    history = LinkHistory(2)
    history.take(links(0.2, 50.0, 0.2, 4, 4))
    for number in range(5):
        history.take(links(0.4 + 0.2 * number, np.nan, np.nan, 8 + number, 5))
        assert history.probability[0, 1] == pytest.approx(0.8)
    history.take(replace(links(1.6, np.nan, np.nan, 16, 5), radio_off=(0,)))
    assert np.isnan(history.probability[0, 1])
    history.take(links(1.8, 50.0, 0.5, 20, 9))
    assert history.probability[0, 1] == pytest.approx(0.5)
