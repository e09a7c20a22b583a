"""What was lost, by cause and time, and just now."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bridge.record.tables.deliveries import FATES, fates_message
from lostlink.view.picture import losses as module
from lostlink.view.picture.losses import Losses
from tests.unit.lostlink.view.fleet import fates


def test_fates_are_counted_by_cause_and_second() -> None:
    losses = Losses(2)
    losses.take(fates(0.1, [(0, 1, 0), (1, 0, 1)]))
    losses.take(fates(0.9, [(0, 1, 1), (1, 0, 1)]))
    losses.take(fates(1.5, [(0, 1, 2)]))
    assert losses.total == {"delivered": 1, "channel_erasure": 3, "out_of_range": 1}
    assert losses.since_s == pytest.approx(0.1)
    time_s, shares = losses.over_time()
    assert time_s.tolist() == [0.0, 1.0]
    assert {cause: share.tolist() for cause, share in shares.items()} == {
        "channel_erasure": [0.75, 0.0],
        "out_of_range": [0.0, 1.0],
    }


def test_packets_are_counted_by_length() -> None:
    losses = Losses(2)
    losses.take(fates(0.1, [(0, 1, 0), (1, 0, 1)]))
    losses.take(replace(fates(0.2, [(0, 1, 0), (1, 0, 1)]), length_bytes=(328, 40)))
    assert losses.lengths == {40: 3, 328: 1}


def test_the_latest_packet_says_who_hears_whom() -> None:
    losses = Losses(2)
    losses.take(fates(0.1, [(0, 1, 0), (1, 0, 1)]))
    assert losses.heard.tolist() == [[False, False], [True, False]]
    losses.take(fates(0.2, [(0, 1, 1)]))
    assert not losses.heard.any()
    assert losses.known.tolist() == [[False, True], [True, False]]


def test_the_delay_is_that_of_the_latest_packet_that_arrived() -> None:
    """Sent at 1, 2 and 3 s: there after 0.25 s, lost, and in the other direction there after 1.5 s."""
    names, second = (
        ("length_bytes", "distance_m", "received_power_dbm", "snr_db", "per", "seq"),
        1_000_000_000,
    )
    columns = {name: np.zeros(3, dtype=np.int64) for name in names} | {
        "tx": np.array([0, 0, 1]),
        "rx": np.array([1, 1, 0]),
        "fate": np.array([FATES.index(fate) for fate in ("delivered", "collided", "delivered")]),
        "packets": np.ones(3, dtype=np.int64),
        "sim_time_ns": np.array([1, 2, 3]) * second,
        "arrived_ns": np.array([1_250_000_000, 9 * second, 4_500_000_000]),
    }
    columns |= {"radio": np.zeros(3, dtype=np.int64), "attempts": np.ones(3, dtype=np.int64)}
    columns |= dict.fromkeys(("entered_ns", "started_ns", "ended_ns"), columns["sim_time_ns"])
    message = fates_message(9 * second, ("0", "gcs"), columns, ("main",))
    assert np.isnan(message.delay_s).tolist() == [False, True, False]
    losses = Losses(2)
    losses.take(message)
    assert losses.delay_s.tolist() == [[0.0, 1.5], [0.25, 0.0]]
    losses.take(replace(message, delay_s=()))  # of a record from before there were any
    assert losses.delay_s.tolist() == [[0.0, 1.5], [0.25, 0.0]]


def test_losses_are_told_once() -> None:
    losses = Losses(2)
    losses.take(fates(0.1, [(0, 1, 1), (0, 1, 1), (1, 0, 2), (1, 0, 0)]))
    assert losses.fresh() == {(0, 1): 2, (1, 0): 1}
    assert losses.fresh() == {}


def test_a_long_run_is_counted_over_longer_spans(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "SPANS_MAX", 10)
    losses = Losses(2)
    for second in range(100):
        losses.take(fates(float(second), [(0, 1, 1), (1, 0, 0)]))
    time_s, shares = losses.over_time()
    assert len(time_s) <= 10
    assert time_s[0] == 0.0
    assert shares["channel_erasure"].tolist() == [0.5] * len(time_s)
    assert losses.total.total() == 200


def test_fates_of_another_fleet_are_not_taken() -> None:
    losses = Losses(3)
    losses.take(fates(0.1, [(0, 1, 0)]))
    assert not losses.total
