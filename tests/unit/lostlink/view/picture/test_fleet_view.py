"""What the view knows after which message."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np

from bridge.bus.messages import AgentStatus, AircraftState, Header, Quaternion, Truth, Truths
from bridge.scenario.file import with_changes
from lostlink.view.page.tables import fleet_rows, link_words, losses_words
from lostlink.view.picture.fleet_view import TRAIL_POINTS, view_of
from lostlink.view.picture.frames import PictureFrames
from tests.unit.lostlink.replay.flown import scenario_of
from tests.unit.lostlink.view.fleet import clock, fates, links, truths, view_of_two


def test_nodes_are_in_the_order_of_the_medium() -> None:
    scenario = scenario_of("moon2020", ("0", "gcs", "1"))
    view = view_of(scenario)
    assert [(node.id, node.kind) for node in view.nodes] == [("0", "ua"), ("gcs", "ground"), ("1", "ua")]
    assert scenario.stations == ("0", "gcs", "1")
    assert [node.title for node in view.nodes] == ["UA 0", "node gcs", "UA 1"]


def test_truths_move_nodes_and_draw_trails() -> None:
    view = view_of_two()
    assert np.isnan(view.position_ned_m).all()
    for tick in range(25):
        view.take(truths(0.1 * tick, 10.0 * tick))
    assert view.position_ned_m[0].tolist() == [240.0, 2.0, -40.0]
    assert view.wind_ned_mps[0].tolist() == [1.0, -2.0, 0.0]
    assert [points[0, 0] for points in view.trail] == [0.0, 50.0, 100.0, 150.0, 200.0]


def test_a_trail_has_an_end() -> None:
    view = view_of_two()
    for second in range(TRAIL_POINTS + 50):
        view.take(truths(float(second), float(second)))
    assert len(view.trail) == TRAIL_POINTS
    assert view.trail_points == TRAIL_POINTS + 50


def test_the_nose_points_where_the_attitude_says() -> None:
    view = view_of_two()
    east = Quaternion(0.0, 0.0, math.sin(math.pi / 4), math.cos(math.pi / 4))
    view.take(Truths(Header.at(0, ""), (Truth(Header.at(0, "0"), attitude=east),)))
    assert math.isclose(view.heading_rad[0], math.pi / 2)


def test_what_nodes_say_is_told_when_it_changes() -> None:
    view = view_of_two()
    view.take(clock(1.0))
    for activity in ("takes off", "takes off", "lands"):
        view.take(AgentStatus(Header.at(0, ""), activity), "0")
    for mode in ("GUIDED", "GUIDED", "", "RTL"):  # of a new boot nothing is known at first
        view.take(AircraftState(mode=mode), "0")
    assert [(line.node, line.text) for line in view.lines] == [
        ("0", "takes off"),
        ("0", "lands"),
        ("0", "mode RTL"),
    ]


def test_what_is_of_nobody_here_is_passed_over() -> None:
    view = view_of_two()
    view.take(AgentStatus(Header.at(0, ""), "hello"), "7")
    view.take(Truths(Header.at(0, ""), (Truth(Header.at(0, "7")),)))
    view.take(fates(0.1, [(0, 1, 0)], nodes=("0", "1", "2")))
    assert not view.lines
    assert np.isnan(view.position_ned_m).all()
    assert not view.losses["main"].total


def test_a_pause_is_shown_and_time_does_not_go_back() -> None:
    view = view_of_two()
    view.take(clock(2.0))
    view.take(clock(1.95, paused=True))
    assert view.clock.paused
    assert view.sim_time_ns == 2_000_000_000


def test_all_can_be_forgotten() -> None:
    view = view_of_two()
    view.take(clock(2.0))
    view.take(truths(2.0, 5.0))
    view.take(links(2.0, 5.0, 0.0, 4, 4))
    view.tell("0", "hello")
    view.logged.take("0", "gap_m", 5, 1.5)
    view.forget()
    assert view.sim_time_ns == 0
    assert not view.trail
    assert not view.lines
    assert view.links["main"].reports == 0
    assert not view.logged.latest["0"]
    assert view.times_forgotten == 1


def test_what_nobody_looked_at_is_forgotten() -> None:
    view = view_of_two()
    view.take(truths(2.0, 5.0))
    view.take(links(2.0, 5.0, 0.0, 4, 4))
    view.take(fates(2.0, [(0, 1, 0)]))
    view.look_anew()
    assert (losses_words(view.losses["main"]), fleet_rows(view, "main")[0]["heard"]) == (
        "no packet yet since this page is open",
        "0/0",
    )
    assert not view.trail
    assert view.links["main"].reports == 1
    view.take(fates(9.0, [(0, 1, 1)]))
    assert losses_words(view.losses["main"]) == "since 9.0 s of sim time, when a page was opened"
    assert view.losses["main"].total == {"channel_erasure": 1}


def test_the_end_is_told_once() -> None:
    view = view_of_two()
    view.end()
    view.end()
    assert [line.text for line in view.lines] == ["the run is over"]


def test_a_radio_that_is_off_is_shown_and_told_once() -> None:
    view, report = view_of_two(), links(1.0, 100.0, 0.5, 10, 5)
    view.take(AircraftState(mode="GUIDED", armed=True), "0")
    frames = PictureFrames(view)
    for off in ((), (1,), (1,), ()):
        view.take(replace(report, radio_off=off))
        assert json.loads(frames.frame())["off"] == json.loads(frames.snapshot())["off"] == list(off)
        assert [row["mode"] for row in fleet_rows(view, "main")] == ["GUIDED", "radio off" if off else "-"]
        words = "UA 0 to node gcs: radio of node gcs off; 5 of 10 packets delivered"
        assert (link_words(view, "main", 0, 1) == words) is bool(off)
    assert [(line.node, line.text) for line in view.lines] == [("gcs", "radio off"), ("gcs", "radio on")]


def test_a_partition_between_two_nodes_is_told() -> None:
    parted = [{"groups": [["0"], ["gcs"]], "from_s": 1.0, "to_s": 2.0}]
    view = view_of(with_changes(scenario_of("moon2020", ("0", "gcs")), {"partitions": parted}))
    words = "UA 0 to node gcs: a partition is between them; 5 of 10 packets delivered"
    for time_s in (0.5, 1.0, 1.5, 2.0):
        view.take(clock(time_s))
        view.take(links(time_s, 100.0, 0.5, 10, 5))
        assert (link_words(view, "main", 0, 1) == words) is (1.0 <= time_s < 2.0)
        assert np.isnan(view.probability()[0, 1]) == (1.0 <= time_s < 2.0)
