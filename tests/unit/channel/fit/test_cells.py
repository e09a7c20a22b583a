"""Packets put together say what they say one by one."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace
from time import process_time, thread_time

import numpy as np
import pytest

from benchmarks.channel.fit_coverage import LENGTH_BYTES, SETS, synthetic_log
from channel.fit import cells
from channel.fit.cells import alike
from channel.fit.columns import log_of_columns
from channel.fit.correlated.field import FINEST_M, places_of
from channel.fit.likelihood import Likelihood
from channel.link.radio import Radio
from channel.presets import load_radio

NAN = float("nan")


def test_rows_with_the_same_values_are_one_group():
    found = alike(np.array([2, 1, 2, 2, 1]), np.array([NAN, 0.5, NAN, 0.0, 0.5]))
    assert found.of_row.tolist() == [2, 0, 2, 1, 0]
    assert found.first.tolist() == [1, 3, 0]
    assert found.count.tolist() == [2.0, 1.0, 2.0]
    assert alike(np.zeros(0), np.zeros(0)).count.tolist() == []


def test_the_likelihood_without_readings_is_the_sum_over_the_packets():
    """Against the link's own probability of delivery, packet by packet."""
    config = load_radio("corrected", {"base_loss": 0.05})
    log = synthetic_log(replace(SETS["no RSSI"], base="corrected", values={}), 20_000, (3,))
    chance = Radio(config).probability_of_delivery(log.distance_m, LENGTH_BYTES)
    expected = np.sum(np.log(np.where(log.delivered, chance, 1.0 - chance)))
    likelihood = Likelihood(log, config)
    assert likelihood.point(likelihood.base_values).value == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("name", ["no RSSI", "open, no base loss", "one-sided, exponent 3.5"])
def test_cells_say_what_their_packets_say_one_by_one(name, monkeypatch):
    log = synthetic_log(SETS[name], 20_000, (3,))
    together = Likelihood(log, SETS[name].truth)
    monkeypatch.setattr(cells, "WIDTH_DECADES", 1e-12)
    apart = Likelihood(log, SETS[name].truth)
    at = apart.base_values
    at[-1] = 0.5
    one, other = together.point(at), apart.point(at)
    deviation = np.sqrt(np.diag(other.information))
    assert one.value == pytest.approx(other.value, abs=1e-3)
    assert np.all(np.abs(one.gradient - other.gradient) <= 0.02 * deviation)
    apart_by = np.abs(one.information - other.information)
    assert np.all(apart_by <= 0.01 * np.outer(deviation, deviation))
    assert together.scores(at) == pytest.approx(apart.scores(at), abs=0.02)
    if together.has_rssi:
        assert together.reading_shares(at) == pytest.approx(apart.reading_shares(at), abs=1e-3)


def test_a_sum_over_the_cells_is_not_shared_among_threads():
    """A BLAS would, for longer than the sum takes: on a machine with more to do fits took ten times the CPU time."""
    log = synthetic_log(SETS["no RSSI"], 40_000, (3,))
    likelihood = Likelihood(log, SETS["no RSSI"].truth)
    at = likelihood.base_values
    likelihood.point(at)
    begin = process_time(), thread_time()
    for _ in range(10):
        likelihood.point(at)
    all_s, ours_s = process_time() - begin[0], thread_time() - begin[1]
    assert all_s < 1.3 * ours_s


def test_places_of_many_links_are_those_of_each():
    rng = np.random.Generator(np.random.PCG64(1))
    link, distance_m = rng.permutation(np.repeat(np.arange(30), 20)), rng.uniform(50.0, 90.0, 600)
    found = places_of(distance_m, link)
    extents_m = [np.ptp(distance_m[link == each]) for each in range(30)]
    assert found.extent_m == max(extents_m)
    assert np.count_nonzero(np.isinf(found.gap_m)) == 29
    step_m = max(FINEST_M, sum(extents_m) / 4000.0)
    assert found.gap_m[np.isfinite(found.gap_m)].sum() == pytest.approx(sum(extents_m), abs=30.0 * step_m)
    for each in range(30):
        order = np.argsort(distance_m[link == each])
        assert np.all(np.diff(found.of_packet[link == each][order]) >= 0)


def test_links_are_numbered_by_their_ends_in_either_direction():
    columns = {
        "distance_m": np.full(5, 10.0),
        "fate": np.array(["delivered"] * 5, dtype=object),
        "tx": np.array(["10", "9", "a", "9", "b"], dtype=object),
        "rx": np.array(["9", "10", "9", "a", "a"], dtype=object),
    }
    assert log_of_columns(columns, load_radio("corrected"), "log").link.tolist() == [0, 0, 1, 1, 2]


def test_reading_columns_takes_little_more_memory_than_the_log(tmp_path):
    rows = 40_000
    names, fates = np.array(["0", "1", "2"], dtype=object), np.array(["delivered", "path_loss"], dtype=object)
    number = np.arange(rows)
    columns = {
        "distance_m": np.linspace(1.0, 900.0, rows),
        "fate": fates[number % 2],
        "tx": names[number % 3],
        "rx": names[(number + 1) % 3],
        "radio": np.full(rows, "main", dtype=object),
        "attempts": np.ones(rows, dtype=np.int32),
    }
    radio = load_radio("corrected")
    log_of_columns(columns, radio, "log")  # imports
    tracemalloc.start()
    log = log_of_columns(columns, radio, "log")
    peak = tracemalloc.get_traced_memory()[1] / rows
    tracemalloc.stop()
    assert log.packets == rows
    assert peak < 150.0  # bytes a packet: 220 with each word as text
