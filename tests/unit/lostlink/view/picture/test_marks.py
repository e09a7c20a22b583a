"""The mission in frames: emitters and shapes, each when it changes, and nothing when nothing does."""

from __future__ import annotations

import json
import math
from typing import Any

from lostlink.view.picture.fleet_view import EmitterInfo, FleetView, NodeInfo, view_of
from lostlink.view.picture.frames import PictureFrames
from lostlink.view.picture.marks import SHAPES_PER_FRAME
from lostlink.view.picture.whole import UNKNOWN
from tests.unit.lostlink.replay.flown import scenario_of
from tests.unit.lostlink.view.fleet import emitter_at, truths, view_of_two, with_emitter

ESTIMATE = {"north_m": 10.0, "east_m": -20.0, "covariance_m2": [4.0, 0.0, 1.0]}
SCALE = math.sqrt(5.991464547107979)


def test_emitters_are_apart_from_nodes() -> None:
    view = view_of(scenario_of("moon2020", ("0", "gcs"), emitters=("beacon",)))
    assert [node.id for node in view.nodes] == ["0", "gcs"]
    assert view.emitters == (EmitterInfo("beacon", 433.92e6, 18.0),)


def test_an_emitter_is_told_when_it_moves() -> None:
    view = with_emitter()
    frames = PictureFrames(view)
    assert json.loads(frames.snapshot())["emitters"] == ["beacon"]
    seen: list[Any] = []
    for north_m in (None, 1.0, 1.0, 1.01, 8.5):
        if north_m is not None:
            view.take(emitter_at(north_m))
        seen.append(json.loads(frames.frame()).get("emitterPlaces"))
    assert seen == [[UNKNOWN] * 3, [10, 20, -30], None, None, [85, 20, -30]]


def test_a_shape_is_told_once_and_taken_away_once() -> None:
    view = view_of_two()
    frames = PictureFrames(view)
    view.logged.take("gcs", "estimate.beacon", 0, ESTIMATE)
    shape = {"node": 1, "name": "estimate.beacon"}
    ellipse = [100, -200, round(20 * SCALE), round(10 * SCALE), 0]
    assert json.loads(frames.frame())["shapes"] == [shape | {"ellipse": ellipse}]
    assert "shapes" not in json.loads(frames.frame())
    assert json.loads(frames.snapshot())["shapes"] == [shape | {"ellipse": ellipse}]
    view.logged.take("gcs", "estimate.beacon", 1, math.nan)
    assert json.loads(frames.frame())["shapes"] == [shape]
    assert json.loads(frames.snapshot())["shapes"] == []


def test_a_plan_is_told_as_north_and_east_in_turn() -> None:
    view = view_of_two()
    view.logged.take("0", "plan", 0, {"north_m": [0, 1.5], "east_m": [2.0, 3.0]})
    assert json.loads(PictureFrames(view).frame())["shapes"] == [
        {"node": 0, "name": "plan", "line": [0, 20, 15, 30]}
    ]


def test_many_changes_are_spread_over_frames() -> None:
    nodes = [NodeInfo(str(number), "ua", f"UA {number}") for number in range(40)]
    view = FleetView(nodes, 60.0)
    frames = PictureFrames(view)
    for node in nodes:
        for name in ("a", "b"):
            view.logged.take(node.id, name, 0, ESTIMATE)
    told = [json.loads(frames.frame()).get("shapes", []) for _ in range(3)]
    assert [len(shapes) for shapes in told] == [SHAPES_PER_FRAME, 80 - SHAPES_PER_FRAME, 0]
    assert len({(shape["node"], shape["name"]) for shapes in told for shape in shapes}) == 80


def test_a_frame_without_news_of_the_mission_has_none_of_it() -> None:
    plain, other = PictureFrames(view_of_two()), with_emitter()
    with_mission = PictureFrames(other)
    other.take(emitter_at(5.0))
    other.logged.take("0", "plan", 0, {"north_m": [0, 1], "east_m": [2, 3]})
    with_mission.frame()
    plain.frame()
    other.logged.take("0", "gap_m", 0, 1.5)
    other.take(truths(0.0, 1.0))
    assert json.loads(with_mission.frame()).keys() - {"trail"} == json.loads(plain.frame()).keys()


def test_what_was_forgotten_is_gone_from_the_map() -> None:
    view = with_emitter()
    frames = PictureFrames(view)
    view.take(emitter_at(5.0))
    view.logged.take("0", "a", 0, ESTIMATE)
    frames.frame()
    view.forget()
    assert frames.begins_anew()
    assert json.loads(frames.snapshot())["shapes"] == []
    view.logged.take("0", "a", 0, ESTIMATE)
    assert len(json.loads(frames.frame())["shapes"]) == 1
