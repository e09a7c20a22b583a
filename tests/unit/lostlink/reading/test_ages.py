"""Age of information and latency, against areas and times worked out by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bridge.record.tables.deliveries import FATES, DeliveryWriter
from bridge.record.tables.every import finish_tables
from lostlink.reading.ages import link_ages, link_latencies, sawtooth, times_of
from lostlink.reading.rows import RecordedDeliveries

S = 1_000_000_000
NODES = ("a", "b", "c")
TICK_NS = S // 10


def times(*seconds: float) -> np.ndarray:
    return np.array([round(second * S) for second in seconds], dtype=np.int64)


def test_a_regular_sawtooth_has_the_mean_of_its_teeth():
    """A packet each second that takes 0.25 s: from the second on the age goes from 0.25 to 1.25 s, evenly."""
    generated = times(*range(1000))
    age = sawtooth(generated, generated + S // 4, begin_ns=S // 4, end_ns=1000 * S + S // 4).age
    assert age == pytest.approx((0.75, 0.25 + 0.95, 1.25))


def test_a_gap_weighs_by_its_area():
    """Heard at 1 s and 2 s of what was sent then, then nothing until 10 s."""
    tooth = sawtooth(times(1, 2), times(1, 2), begin_ns=0, end_ns=10 * S)
    mean_s, p95_s, peak_s = tooth.age
    assert mean_s == pytest.approx((0.5 + 0.5 + 32.0) / 10)
    assert (p95_s, peak_s) == (pytest.approx(8.0 - 0.5), 8.0)
    assert tooth.greatest(times(0, 1, 1.5, 3, 10, 11)) == pytest.approx([1, 0.5, 1, 8, np.nan], nan_ok=True)


def test_an_older_packet_that_comes_late_changes_nothing():
    with_old = sawtooth(times(1, 3, 2), times(1, 3, 4), begin_ns=0, end_ns=6 * S)
    without = sawtooth(times(1, 3), times(1, 3), begin_ns=0, end_ns=6 * S)
    assert with_old.age == pytest.approx(without.age)
    assert without.age == pytest.approx(((0.5 + 2.0 + 4.5) / 6, 3 - 0.3, 3.0))


def test_without_a_packet_the_age_counts_from_the_begin():
    nothing = sawtooth(times(), times(), begin_ns=2 * S, end_ns=12 * S)
    assert nothing.age == pytest.approx((5.0, 9.5, 10.0))
    assert np.isnan(sawtooth(times(), times(), begin_ns=S, end_ns=S).age).all()
    after_the_end = sawtooth(times(5), times(13), begin_ns=2 * S, end_ns=12 * S)
    assert after_the_end.age == nothing.age


def test_what_came_before_the_begin_is_known_then():
    """Of 1 s, 2 s and 9 s, each a second later; looked at from 5 s to 12 s."""
    part = sawtooth(times(1, 2, 9), times(2, 3, 10), begin_ns=5 * S, end_ns=12 * S)
    assert part.age.peak_s == 8.0
    assert part.age.mean_s == pytest.approx(((3 + 8) / 2 * 5 + (1 + 3) / 2 * 2) / 7)


def test_of_packets_that_come_at_once_the_newest_counts():
    both = sawtooth(times(1, 5), times(6, 6), begin_ns=0, end_ns=7 * S)
    assert both.age.peak_s == 6.0
    assert len(both.begin_ns) == 2


def test_quantile_against_samples_of_the_age_itself():
    rng = np.random.default_rng(3)
    generated = np.cumsum(rng.integers(1, 3 * S, 300))
    received = np.maximum.accumulate(generated + rng.integers(0, S, 300))
    tooth = sawtooth(generated, received, begin_ns=0, end_ns=int(received[-1]) + S)
    at = np.linspace(0, int(received[-1]) + S, 400_001)
    last = np.searchsorted(received, at, side="right")
    age_s = (at - np.concatenate([[0], np.maximum.accumulate(generated)])[last]) / S
    assert tooth.age == pytest.approx((age_s.mean(), np.quantile(age_s, 0.95), age_s.max()), rel=1e-3)


@pytest.mark.parametrize("is_finished", [True, False])
def test_links_of_a_table(tmp_path: Path, is_finished: bool):
    """a sends each tick for 2 s: b hears all, c nothing; b's packet is lost before the radio, to everybody."""
    writer = DeliveryWriter(tmp_path, NODES)
    unknown = dict.fromkeys(("distance_m", "received_power_dbm", "snr_db", "per"), np.nan)
    for tick in range(20):
        for rx, fate in ((1, "delivered"), (2, "out_of_range")):
            writer.append(
                1,
                sim_time_ns=tick * TICK_NS,
                tx=0,
                rx=rx,
                seq=tick,
                length_bytes=40,
                fate=FATES.index(fate),
                received_ns=(tick + 1) * TICK_NS,
                **unknown,
            )
    lost = FATES.index("transport")
    writer.append(
        1, sim_time_ns=S, tx=1, rx=3, seq=0, packets=2, length_bytes=40, fate=lost, received_ns=0, **unknown
    )
    writer.close()
    if is_finished:
        finish_tables(tmp_path)
    heard = times_of(RecordedDeliveries(tmp_path, NODES))
    ages = link_ages(heard, 2 * S)
    assert [divmod(each.link, len(NODES)) for each in heard] == [(0, 1), (0, 2), (1, 0), (1, 2)]
    assert ages["received"].tolist() == [20, 0, 0, 0]
    first_tooth, others = 0.1 * 0.05, 1.9 * 0.15
    assert ages["mean_s"] == pytest.approx([(first_tooth + others) / 2, 1.0, 0.5, 0.5])
    assert ages["peak_s"] == pytest.approx([0.2, 2.0, 1.0, 1.0])
    latencies = link_latencies(heard)
    assert latencies["max_s"] == pytest.approx([0.1, np.nan, np.nan, np.nan], nan_ok=True)
    assert latencies["mean_s"] == pytest.approx([0.1, np.nan, np.nan, np.nan], nan_ok=True)
