"""What tests of users ask of a flight: answers from a made record whose numbers are known."""

from __future__ import annotations

import asyncio
import math
from types import SimpleNamespace

import numpy as np
import pytest

from bridge.record.tables.schema import TableError
from lostlink.reading.run import load_run
from lostlink.testing.flight import FleetFlight, UaOfFlight
from lostlink.testing.views import _PLACE, Place, RecordedLink, RecordedNode
from tests.unit.lostlink.replay.flown import Sent, flown, scenario_of


class Made:
    """A record: node 1 flies north at 10 m/s for 10 s, 20 m up; node 0 stands. A packet a second, the odd ones lost."""

    nodes = ("0", "1")

    def columns(self, table, columns=None):
        ticks = np.arange(0, 10_500_000_000, 500_000_000)
        if table == "truth":
            return {
                "tick_ns": np.repeat(ticks, 2),
                "node": np.tile(np.array(["0", "1"], dtype=object), len(ticks)),
                "position_north_m": np.stack([np.zeros(len(ticks)), ticks / 1e8], axis=1).ravel(),
                "position_east_m": np.zeros(2 * len(ticks)),
                "position_down_m": np.full(2 * len(ticks), -20.0),
            }
        if table == "states":
            return {"tick_ns": ticks, "node": np.full(len(ticks), "1", dtype=object)}
        count = np.arange(10)
        return {
            "sim_time_ns": count * 10**9,
            "tx": np.full(10, "0", dtype=object),
            "rx": np.full(10, "1", dtype=object),
            "packets": np.ones(10, dtype=np.int32),
            "distance_m": 10.0 * count,
            "fate": np.where(count % 2, "channel_erasure", "delivered").astype(object),
            "radio": np.where(count < 8, "main", "video").astype(object),
        }


class Standing(Made):
    """That record, with both nodes a little below and beside the origin."""

    def columns(self, table, columns=None):
        found = super().columns(table)
        return found | {name: np.full_like(found[name], 0.04 if "down" in name else -0.04) for name in _PLACE}


class Ticking(Made):
    """That record, with a packet at each tick of 50 ms."""

    def columns(self, table, columns=None):
        assert table == "deliveries"
        packet = {name: column[:1] for name, column in super().columns(table).items()}
        ticks = {name: np.repeat(column, 200) for name, column in packet.items()}
        return ticks | {"sim_time_ns": np.arange(200) * 50_000_000}


class Becoming(Made):
    """That record, which cannot be read the first times: ``troubles`` are raised, one at each look."""

    def __init__(self, *troubles):
        self.troubles = list(troubles)

    def columns(self, table, columns=None):
        if self.troubles:
            raise self.troubles.pop(0)
        return super().columns(table, columns)


class MadeFlight(FleetFlight):
    """A flight of that record, over or not; it fails."""

    is_over = False

    def __init__(self, record, is_over=False):
        self.made, self.is_over, self.end_s = record, is_over, 0.0
        self._flight = SimpleNamespace(scenario=SimpleNamespace(tick_rate_hz=2))
        self._summary = {"ending": "failed", "error": "the agent of UA 1 failed", "verdict": None}

    @property
    def record(self):
        return self.made

    def recorded_s(self):
        return 10.0


class Growing(MadeFlight):
    """A flight whose record grows by a second at each look; it is over after ten."""

    def __init__(self):
        super().__init__(Made())
        self.looks = 0

    @property
    def is_over(self):
        return self.looks > 10

    @is_over.setter
    def is_over(self, value): ...

    def recorded_s(self):
        self.looks += 1
        return min(float(self.looks), 10.0)


def test_a_record_that_cannot_be_read_yet_is_waited_for():
    record = Becoming(TableError("it has no truth.parquet"), FileNotFoundError("truth.journal"))
    assert asyncio.run(UaOfFlight(MadeFlight(record), "1").at(north_m=60.0)) == 5.5
    assert record.troubles == []


def test_of_a_flight_that_is_over_no_record_is_waited_for():
    ua = UaOfFlight(MadeFlight(Becoming(TableError("damaged")), is_over=True), "1")
    with pytest.raises(TableError, match="damaged"):
        asyncio.run(ua.at(north_m=60.0))
    with pytest.raises(ValueError, match="a place needs"):
        asyncio.run(ua.at())


def test_when_a_node_first_is_near_a_place():
    ua = RecordedNode(Made(), "1")
    assert ua.reaches(Place(north_m=60.0, height_m=20.0), within_m=5.0) == 5.5
    assert ua.reaches(Place(north_m=60.0), within_m=5.0, after_s=6.2) == 6.5
    assert ua.reaches(Place(east_m=0.0), within_m=0.1) == 0.0


def test_a_place_that_is_not_reached_is_told_with_the_nearest():
    ua = RecordedNode(Made(), "1")
    with pytest.raises(AssertionError, match=r"nearest was 20\.0 m at 10\.00 s"):
        ua.reaches(Place(north_m=120.0), within_m=5.0)
    with pytest.raises(AssertionError, match=r"nearest was 60\.0 m at 4\.00 s"):
        ua.reaches(Place(north_m=100.0), within_m=5.0, before_s=4.0)
    with pytest.raises(AssertionError, match="nothing was recorded"):
        ua.reaches(Place(north_m=1.0), after_s=11.0)
    with pytest.raises(ValueError, match="north_m, east_m or height_m"):
        Place()


def test_where_a_node_was():
    ua = RecordedNode(Made(), "1")
    assert ua.position_ned_m(3.2).tolist() == [30.0, 0.0, -20.0]
    assert ua.position_ned_m(10.4)[0] == 100.0
    with pytest.raises(
        ValueError, match=r"nothing is recorded of it after 10\.00 s, and 10\.5 s was asked for"
    ):
        ua.position_ned_m(10.5)
    with pytest.raises(ValueError, match="nothing is recorded"):
        ua.state(99.0)
    assert ua.state(3.2)["tick_ns"] == 3_000_000_000
    with pytest.raises(ValueError, match="not there yet"):
        ua.position_ned_m(-1.0)


def test_answers_of_a_flight_that_goes_on_wait_for_their_time_and_go_as_far_as_was_waited(monkeypatch):
    monkeypatch.setattr("lostlink.testing.flight.LOOK_S", 0.0)
    flight = Growing()
    assert flight.ua("1").position_ned_m(3.2).tolist() == [32.0 // 5 * 5, 0.0, -20.0]
    assert flight.looks == 4, "and no longer"
    assert flight.ua("1").track()[0].max() == 3.0
    assert len(flight.link("0", "1").packets()["tx"]) == 4, "0, 1, 2, 3 s"
    assert len(flight.link("0", "1").packets(to_s=6.0)["tx"]) == 6
    assert flight.looks < 10
    assert len(flight.link("0", "1").packets()["tx"]) == 6
    with pytest.raises(AssertionError, match=r"there and then from 6\.5 to 6\.0 s"):
        flight.link("0", "1").delivery(from_s=6.5)
    assert asyncio.run(flight.ua("1").at(north_m=80.0, within_m=1.0)) == 8.0
    for wrong in (-1.0, math.nan):
        with pytest.raises(ValueError, match="within_m"):
            asyncio.run(flight.ua("1").at(north_m=80.0, within_m=wrong))
    assert len(flight.link("0", "1").packets()["tx"]) == 8
    with pytest.raises(ValueError, match="nothing is recorded"):
        flight.ua("1").position_ned_m(20.0)
    assert flight.is_over


def test_what_is_asked_of_after_the_end_of_a_flight_is_told_how_it_ended(monkeypatch):
    monkeypatch.setattr("lostlink.testing.flight.LOOK_S", 0.0)
    flight = Growing()
    ended = r"the flight ended at 10\.00 s, before 14\.0 s: failed; the agent of UA 1 failed"
    for ask in (flight.link("0", "1").delivery, flight.link("0", "1").packets):
        with pytest.raises(AssertionError, match=f"^{ended}"):
            ask(to_s=14.0)
    for ask in (flight.ua("1").state, flight.ua("1").position_ned_m):
        with pytest.raises(ValueError, match=rf"14\.0 s was asked for; {ended}"):
            ask(14.0)
    with pytest.raises(AssertionError, match=rf"at 10\.00 s; {ended}"):
        asyncio.run(flight.ua("1").at(north_m=200.0, before_s=14.0))
    with pytest.raises(AssertionError, match=r"at 10\.00 s; the flight ended at 10\.00 s: failed; the agent"):
        asyncio.run(flight.ua("1").at(north_m=200.0))
    assert flight.link("0", "1").delivery(to_s=10.4) == 0.5, "its last tick holds until 10.5 s"


def test_what_a_link_delivered_by_time_and_distance():
    link = RecordedLink(Made(), "0", "1")
    assert link.delivery() == 0.5
    assert link.delivery(from_s=2.0, to_s=3.0) == 1.0
    assert link.delivery(min_m=10.0, max_m=40.0) == pytest.approx(1 / 3)
    with pytest.raises(AssertionError, match="nothing was sent from 0 to 1"):
        link.delivery(from_s=100.0)
    with pytest.raises(AssertionError, match="nothing was sent from 1 to 0"):
        RecordedLink(Made(), "1", "0").delivery()


def test_what_an_assertion_shows_of_them():
    link = RecordedLink(Made(), "0", "1")
    assert repr(link) == "<RecordedLink 0 -> 1: main 4 of 8 delivered; video 1 of 2 delivered>"
    assert repr(RecordedLink(Made(), "1", "0")) == "<RecordedLink 1 -> 0: nothing sent>"
    assert repr(RecordedNode(Made(), "1")) == "<RecordedNode 1: 100.0 m N, 0.0 m E, 20.0 m up at 10.00 s>"
    standing = repr(RecordedNode(Standing(), "1"))
    assert standing == "<RecordedNode 1: 0.0 m N, 0.0 m E, 0.0 m up at 10.00 s>"
    broken = Becoming(*[TableError("damaged")] * 2)
    assert repr(RecordedLink(broken, "0", "1")) == "<RecordedLink 0 -> 1>"
    assert repr(RecordedNode(broken, "1")) == "<RecordedNode 1>"


def test_what_is_shown_of_a_flight_that_goes_on_is_what_was_waited_for():
    flight = Growing()
    flight.has_waited_for(3.0)
    assert repr(flight.link("0", "1")) == "<RecordedLink 0 -> 1: main 2 of 3 delivered>"
    assert repr(flight.ua("1")) == "<UaOfFlight 1: 30.0 m N, 0.0 m E, 20.0 m up at 3.00 s>"
    assert flight.looks == 0


def test_a_packet_of_the_very_begin_is_inside_and_of_the_end_outside():
    """2.05 s is tick 41, and 2.05 * 1e9 is less than its time; 8.3 * 1e9 is more than that of tick 166."""
    link = RecordedLink(Ticking(), "0", "1")
    for begin, end in ((40, 41), (41, 42), (165, 166), (166, 167)):
        found = link.packets(from_s=begin / 20, to_s=end / 20)["sim_time_ns"]
        assert found.tolist() == [begin * 50_000_000]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("radio", "lost"), [("telemetry-915", "queue_full"), ("wifi-2.4", "too_long"), ("wifi-2.4", "transport")]
)
def test_what_never_was_on_the_air_is_not_left_out(tmp_path, radio, lost):
    """Its row has no distance, and may be one for everybody; the host's losses alone have none at all."""
    sent = {
        "queue_full": lambda _: [Sent("0", length=200)],
        "too_long": lambda tick: [Sent("0", length=3000 if tick % 2 else 40)],
        "transport": lambda tick: [Sent("0", lost=tick % 2)],
    }
    run = load_run(flown(tmp_path / "run", scenario_of(radio, ("0", "1", "gcs")), 80, sent[lost]))
    ((count, delivered, missing),) = run.links.query("tx == '0' and rx == '1'")[
        ["sent", "delivered", lost]
    ].values
    assert missing > 9
    link = RecordedLink(run, "0", "1")
    assert link.delivery() == delivered / count
    placed = count - missing if lost == "transport" else count
    assert link.delivery(max_m=5000.0) == delivered / placed
    middle_m = float(np.nanmedian(link.packets()["distance_m"]))
    near, far = link.packets(max_m=middle_m)["packets"], link.packets(min_m=middle_m)["packets"]
    assert near.sum() + far.sum() == placed
    assert min(near.sum(), far.sum()) > 0.3 * placed


@pytest.mark.parametrize(
    "kind", [lambda run: RecordedNode(run, "7"), lambda run: RecordedLink(run, "0", "7")]
)
def test_a_node_that_is_not_there_is_named(kind):
    with pytest.raises(ValueError, match="no node '7'; there are 0, 1"):
        kind(Made())
