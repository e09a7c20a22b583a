"""The use of the air, waits and delays by network over time: of a few frames by hand, and of a record as its table."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bridge.bus.messages import Fates, Header
from bridge.record.tables.deliveries import DELIVERIES, FATES
from bridge.record.tables.reader import read_columns
from lostlink.replay.player import Player
from lostlink.view.page.charts import LIGHT, air_chart
from lostlink.view.page.tables import air_rows, air_words
from lostlink.view.picture import air_history as module
from lostlink.view.picture.air_history import AirHistory
from lostlink.view.picture.fleet_view import view_of
from lostlink.view.sources.record import RecordSource
from tests.unit.lostlink.replay.flown import everybody, flown, scenario_of

TWO = "networks: {tele: xbee-900hp}\n"
MS = 1_000_000
NS = 1_000_000_000
DELIVERED, COLLIDED = FATES.index("delivered"), FATES.index("collided")


def settled(at_s: float, *rows: tuple[int, int, int, int, int, int, int]) -> Fates:
    """Rows of transmitter, receiver, fate, entered, started, ended (ms), attempts, on the second of two networks."""
    tx, rx, fate, entered, started, ended, attempts = np.array(rows, dtype=np.int64).T
    at_ms = ended + 1
    return Fates(
        Header.at(round(at_s * NS), ""),
        ("0", "1", "gcs"),
        FATES,
        tx,
        rx,
        *(np.zeros(len(rows), dtype=np.int64) for _ in range(3)),
        *(np.zeros(len(rows)) for _ in range(4)),
        packets=np.ones(len(rows), dtype=np.int64),
        fate=fate.astype(np.uint8).tobytes(),
        delay_s=(at_ms - entered) / 1e3,
        network=("main", "wifi"),
        radio=np.ones(len(rows), dtype=np.int64),
        entered_ns=entered * MS,
        started_ns=np.where(started < 0, -1, started * MS),
        ended_ns=np.where(ended < 0, -1, ended * MS),
        attempts=attempts,
    )


def test_frames_count_once_whoever_hears_them_and_each_attempt_as_long_as_the_last() -> None:
    air = AirHistory(3)
    air.take(
        settled(
            0.5,
            (0, 1, DELIVERED, 100, 110, 160, 1),
            (0, 2, COLLIDED, 100, 110, 160, 1),
            (1, 0, DELIVERED, 100, 130, 230, 3),
        )
    )
    air.take(settled(0.7, (0, 2, DELIVERED, 100, 110, 160, 1)))  # the same frame at another receiver, later
    air.take(settled(1.6, (2, 0, FATES.index("expired"), 1000, -1, -1, 0)))
    air.take(settled(2.1, (2, 0, DELIVERED, 1100, 1300, 1400, 1)))
    assert air.networks == ["wifi"]
    series = air.series("wifi")
    assert series.time_s.tolist() == [0.0, 1.0]
    assert series.use.tolist() == pytest.approx([0.05 + 3 * 0.1, 0.1])
    assert series.waiting.tolist() == pytest.approx([0.01 + 0.03, 0.2])
    assert series.wait_s.tolist() == pytest.approx([0.02, 0.2])
    assert series.delay_s.tolist() == pytest.approx([(0.061 + 0.131 + 0.061) / 3, 0.301])


def test_where_nodes_hand_packets_on_delays_alone_are_told() -> None:
    """A fate has the hop that decided: of the others' frames, and of their waits, nothing is known."""
    view = view_of(scenario_of("{preset: wifi-2.4, routing: mesh}", ("0", "1", "gcs"), extra=TWO))
    rows = ((0, 1, DELIVERED, 100, 110, 160, 1),)
    view.take(replace(settled(0.5, *rows), network=("tele", "main")))
    view.take(replace(settled(1.6, (1, 0, DELIVERED, 1000, 1100, 1200, 1)), network=("main", "tele")))
    assert (view.air.networks, view.air.routed) == (["main", "tele"], ["main"])
    hops, alone = view.air.series("main"), view.air.series("tele")
    for unknown in (hops.use, hops.waiting, hops.wait_s):
        assert np.isnan(unknown).all()
    assert hops.delay_s.tolist() == pytest.approx([0.061])
    assert np.isfinite(alone.use).all()
    row, _ = air_rows(view)
    assert (row["use"], row["waiting"], row["wait"], row["delay"]) == ("", "", "", "0.061")
    assert air_words(view).startswith("main: use and waits are left out, as nodes hand packets on (routing)")
    chart = air_chart({"main": hops, "tele": alone}, LIGHT)
    assert [line["name"] for line in chart["series"]] == ["main: delay", "tele: in use", "tele: delay"]
    view.look_anew()
    view.take(replace(settled(0.5, *rows), network=("tele", "main")))
    assert view.air.routed == ["main"]


def test_sums_widen_and_nothing_is_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "SPANS_MAX", 4)
    air = AirHistory(3)
    for second in range(9):
        air.take(
            settled(second + 0.9, (0, 1, DELIVERED, *(1000 * second + each for each in (0, 100, 350)), 1))
        )
    series = air.series("wifi")
    assert series.time_s.tolist() == [0.0, 4.0]
    assert series.use.tolist() == pytest.approx([0.25, 0.25])
    assert series.waiting.tolist() == pytest.approx([0.1, 0.1])


def test_what_was_before_somebody_looked_is_no_idle_air() -> None:
    air = AirHistory(3)
    air.take(settled(5.2, (0, 1, DELIVERED, 5000, 5100, 5600, 1)))
    air.take(settled(7.2, (0, 1, DELIVERED, 6000, 6100, 6600, 1)))
    assert air.series("wifi").time_s.tolist() == [5.0, 6.0]
    assert air.series("wifi").use.tolist() == pytest.approx([0.5, 0.5])


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three nodes that load a radio of 64 kb/s for 10 s."""
    scenario = scenario_of("telemetry-915", ("0", "gcs", "1"))
    return flown(tmp_path_factory.mktemp("runs") / "made", scenario, 210, everybody(("0", "gcs", "1"), 90))


@pytest.mark.slow
def test_a_record_shows_what_its_table_has(run: Path) -> None:
    view = view_of(scenario_of("telemetry-915", ("0", "gcs", "1")))
    source = RecordSource(Player.open(run), view, lambda: 0.0)
    assert air_words(view).startswith("no frame yet: ")
    source.speed(float("inf"))
    for _ in range(1000):
        source.play()
    series = view.air.series("main")
    rows = read_columns(run, DELIVERIES)
    air_ns: dict[tuple[int, int], int] = {}
    packets: dict[tuple[int, int], tuple[int, int]] = {}
    columns = ("tx", "seq", "started_ns", "ended_ns", "entered_ns", "attempts")
    for tx, seq, begin, end, entered, attempts in zip(
        *(rows[name].tolist() for name in columns), strict=True
    ):
        if end > begin:
            whole = attempts * (end - begin)
            air_ns[tx, begin] = min(air_ns.get((tx, begin), whole), whole)
            packets[tx, seq] = (begin, begin - entered)
    seconds = range(len(series.time_s))
    use = [sum(air for (_, begin), air in air_ns.items() if begin // NS == second) for second in seconds]
    waits = [sum(wait for begin, wait in packets.values() if begin // NS == second) for second in seconds]
    assert series.use.tolist() == pytest.approx([each / NS for each in use])
    assert series.waiting.tolist() == pytest.approx([each / NS for each in waits])
    assert len(series.use) >= 9
    assert 0.3 < series.use[-1] < 1.0
    [row] = air_rows(view)
    assert air_words(view) == ""
    assert row["network"] == "main"
    assert row["use"] == f"{100 * series.use[-1]:.0f} %"
    chart = air_chart({"main": series}, LIGHT)
    assert [line["name"] for line in chart["series"]] == ["main: in use", "main: delay"]
