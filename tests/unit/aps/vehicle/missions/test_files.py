import json
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from aps.vehicle.missions.files import (
    FlightPlan,
    jumps_moved,
    read_plan,
    read_waypoints,
    write_plan,
    write_waypoints,
)
from aps.vehicle.missions.items import MissionItem

MISSION = [
    MissionItem(22, (0.0, 0.0, 0.0, math.nan, 47.3977001, 8.5456001, 20.0)),
    MissionItem(16, (3.0, 0.0, 0.0, 0.0, 47.398, 8.546, 25.5)),
    MissionItem(178, (1.0, 5.0, -1.0, 0.0, 0.0, 0.0, 0.0), frame=2, autocontinue=False),
]
FENCE = [
    *(MissionItem(5001, (3.0, 0.0, 0.0, 0.0, 47.0 + n, 8.0, 0.0)) for n in range(3)),
    *(MissionItem(5001, (3.0, 0.0, 0.0, 0.0, 48.0, 8.0 + n, 0.0)) for n in range(3)),
    MissionItem(5004, (50.0, 0.0, 0.0, 0.0, 47.5, 8.5, 0.0)),
]
RALLY = [MissionItem(5100, (0.0, 0.0, 0.0, 0.0, 47.4, 8.4, 30.0))]
HOME = (47.3977, 8.5456, 488.0)

# As QGroundControl 4.4 writes it, shortened.
QGC = """{
    "fileType": "Plan",
    "geoFence": {"circles": [{"circle": {"center": [47.5, 8.5], "radius": 50}, "inclusion": false, "version": 1}],
                 "polygons": [], "version": 2},
    "groundStation": "QGroundControl",
    "mission": {
        "cruiseSpeed": 15, "firmwareType": 3, "globalPlanAltitudeMode": 1, "hoverSpeed": 5,
        "items": [
            {"AMSLAltAboveTerrain": null, "Altitude": 20, "AltitudeMode": 1, "autoContinue": true, "command": 22,
             "doJumpId": 1, "frame": 3, "params": [0, 0, 0, null, 47.3977001, 8.5456001, 20], "type": "SimpleItem"},
            {"TransectStyleComplexItem": {"Items": [
                {"autoContinue": true, "command": 16, "doJumpId": 2, "frame": 3,
                 "params": [3, 0, 0, 0, 47.398, 8.546, 25.5], "type": "SimpleItem"}]},
             "complexItemType": "survey", "type": "ComplexItem"}
        ],
        "plannedHomePosition": [47.3977, 8.5456, 488], "vehicleType": 2, "version": 2
    },
    "rallyPoints": {"points": [[47.4, 8.4, 30]], "version": 2},
    "version": 1
}"""


def test_a_plan_of_qgroundcontrol():
    plan = read_plan(QGC)
    assert repr(plan.mission) == repr(MISSION[:2])
    assert plan.fence == [FENCE[-1]]
    assert plan.rally == RALLY
    assert plan.home == HOME


def test_a_plan_is_the_same_after_writing_and_reading():
    written = write_plan(FlightPlan(MISSION, FENCE, RALLY, HOME))
    plan = read_plan(written)
    assert repr((plan.mission, plan.fence, plan.rally, plan.home)) == repr((MISSION, FENCE, RALLY, HOME))
    content = json.loads(written)
    assert [len(polygon["path"]) for polygon in content["geoFence"]["polygons"]] == [3, 3]
    assert content["mission"]["items"][0]["params"][3] is None


def test_items_that_give_no_place_are_null_in_a_plan_and_0_in_a_waypoint_file():
    here = MissionItem(22, (0.0, 0.0, 0.0, 0.0, math.nan, math.nan, 20.0))
    written = write_plan(FlightPlan([here, MISSION[1]]))
    content = json.loads(written)["mission"]
    assert content["items"][0]["params"] == [0.0, 0.0, 0.0, 0.0, None, None, 20.0]
    assert content["plannedHomePosition"] == list(MISSION[1].params[4:])  # the first place there is
    assert repr(read_plan(written).mission[0]) == repr(here)
    assert read_waypoints(write_waypoints([here])).mission[0].params[4:] == (0.0, 0.0, 20.0)
    nowhere = read_waypoints("QGC WPL 110\n0\t1\t0\t16\t0\t0\t0\t0\tnan\tnan\tnan\t1\n")
    assert nowhere.home is None


@pytest.mark.parametrize(
    ("plan", "message"),
    [
        (FlightPlan(rally=[MissionItem(5100, (0, 0, 0, 0, math.nan, 8.0, 9.0))]), "a rally point has 3 numb"),
        (FlightPlan(fence=[MissionItem(5001, (3, 0, 0, 0, 47.0, math.nan, 0))]), "a vertex has 2 numbers"),
        (FlightPlan(fence=[MissionItem(5003, (3, 0, 0, 0, math.nan, 8.0, 0))]), "the centre of a circle has"),
        (FlightPlan(fence=[MissionItem(5000, (3, 0, 0, 0, 47.0, 8.0, math.nan))]), "the return point of a"),
    ],
)
def test_what_is_at_no_place_is_no_part_of_a_plan(plan, message):
    with pytest.raises(ValueError, match=message):
        write_plan(plan)


def test_a_waypoint_file_begins_with_home():
    text = write_waypoints(MISSION, HOME)
    lines = text.splitlines()
    assert lines[0] == "QGC WPL 110"
    assert lines[1].split("\t")[:4] == ["0", "1", "0", "16"]
    plan = read_waypoints(text)
    assert plan.home == HOME
    assert [item.params[4:] for item in plan.mission] == [item.params[4:] for item in MISSION]
    assert plan.mission[0].params[3] == 0.0  # a waypoint file knows no NaN
    assert plan.mission[2] == MISSION[2]


def test_pymavlink_reads_the_waypoint_file_as_we_do(tmp_path):
    from pymavlink import mavwp

    path = tmp_path / "mission.txt"
    path.write_text(write_waypoints(MISSION, HOME))
    loader = mavwp.MAVWPLoader()
    assert loader.load(str(path)) == 4
    assert [(loader.wp(n).command, loader.wp(n).x, loader.wp(n).z) for n in range(4)] == [
        (16, 47.3977, 488.0),
        (22, 47.3977001, 20.0),
        (16, 47.398, 25.5),
        (178, 0.0, 0.0),
    ]
    loader.save(str(path))
    assert read_waypoints(path.read_text()).mission[1] == MISSION[1]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "line 1: a waypoint file begins with 'QGC WPL 110'"),
        ("QGC WPL 110\n0 1 0 16\n", "line 2: 12 columns are expected, not 4"),
        ("QGC WPL 110\n1\t0\t3\t16\t0\t0\t0\t0\t0\t0\t0\t1\n", "line 2: item 1 is where item 0 should be"),
        ("QGC WPL 110\n0\t0\t3\t16\t0\t0\t0\t0\t99\t0\t0\t1\n", "line 2: .* no latitude"),
    ],
)
def test_what_is_no_waypoint_file(text, message):
    with pytest.raises(ValueError, match=message):
        read_waypoints(text)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda plan: plan.update(fileType="Parameters"), "fileType"),
        (lambda plan: plan["mission"].update(items={}), "'items' of a plan is a list"),
        (lambda plan: plan["mission"]["items"][0].pop("frame"), "item 0 has no 'frame'"),
        (
            lambda plan: plan["mission"]["items"][1].pop("TransectStyleComplexItem"),
            "a survey without its items",
        ),
        *(
            (
                lambda plan, other=other: plan["mission"]["items"][1].update(
                    TransectStyleComplexItem={"Items": other}
                ),
                "'Items' of a plan is a list",
            )
            for other in (None, 3)
        ),
        (lambda plan: plan["rallyPoints"].update(points=[[1, 2]]), "a rally point has 3 numbers"),
        (lambda plan: plan["rallyPoints"].update(points=[[1, 2, 10**400]]), "a rally point: .* too large"),
        (lambda plan: plan["rallyPoints"].update(points=[[1, math.nan, 3]]), "3 numbers that are finite"),
        (lambda plan: plan["mission"]["items"][0].update(params=[10**400] * 7), "item 0: params .* finite"),
        (
            lambda plan: plan["geoFence"].update(circles=[{"circle": {"center": [1, 2]}}]),
            "radius of a circle",
        ),
    ],
)
def test_what_is_wrong_in_a_plan_is_named(change, message):
    plan = json.loads(QGC)
    change(plan)
    with pytest.raises(ValueError, match=message):
        read_plan(json.dumps(plan))


_JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(
            st.sampled_from(
                [
                    "items",
                    "type",
                    "command",
                    "params",
                    "frame",
                    "polygons",
                    "path",
                    "circles",
                    "circle",
                    "center",
                ]
            ),
            inner,
            max_size=4,
        )
    ),
    max_leaves=12,
)


@given(_JSON, _JSON, _JSON)
def test_any_plan_is_read_or_refused_with_a_value_error(mission, fence, rally):
    text = json.dumps({"fileType": "Plan", "mission": mission, "geoFence": fence, "rallyPoints": rally})
    try:
        read_plan(text)
    except ValueError:
        return


@given(st.text(max_size=200))
def test_any_waypoint_file_is_read_or_refused_with_a_value_error(text):
    try:
        read_waypoints("QGC WPL 110\n" + text)
    except ValueError:
        return


def jump_plan(*items):
    """A plan of way points and jumps: (doJumpId, target or None)."""
    return json.dumps(
        {
            "fileType": "Plan",
            "mission": {
                "items": [
                    {
                        "type": "SimpleItem",
                        "command": 16 if target is None else 177,
                        "frame": 3 if target is None else 2,
                        "params": [0, 0, 0, 0, 47, 8, 20] if target is None else [target, 3, 0, 0, 0, 0, 0],
                    }
                    | ({} if jump_id is None else {"doJumpId": jump_id})
                    for jump_id, target in items
                ]
            },
        }
    )


def test_a_jump_leads_to_the_item_whose_doJumpId_it_has():  # noqa: N802
    """As QGroundControl reads it (MissionController::_loadItemsFromJson); ids are mostly numbers, but need not be."""
    plan = read_plan(jump_plan((7, None), (9, None), (3, 9), (4, None)))
    assert plan.mission[2].params[:2] == (2.0, 3.0)
    assert read_plan(jump_plan((None, None), (None, None), (None, 2))).mission[2].params[0] == 2.0
    assert read_plan(write_plan(plan)).mission == plan.mission
    with pytest.raises(ValueError, match=r"^a DO_JUMP leads to doJumpId 5, and no item has that$"):
        read_plan(jump_plan((1, None), (2, 5)))
    with pytest.raises(ValueError, match=r"^item 0: doJumpId is a whole number, not '1'$"):
        read_plan(jump_plan(("1", None)))


def test_jumps_of_an_autopilot_that_does_not_count_home():
    mission = read_plan(jump_plan((1, None), (2, None), (3, 2))).mission
    moved = jumps_moved(mission, -1)
    assert [item.params[0] for item in moved] == [0.0, 0.0, 1.0]
    assert moved[:2] == mission[:2]
    assert jumps_moved(moved, 1) == mission


@pytest.mark.parametrize(("frame", "name"), [(0, "GLOBAL"), (10, "GLOBAL_TERRAIN_ALT")])
def test_a_plan_has_no_rally_points_that_are_not_above_home(frame, name):
    place = (0.0, 0.0, 0.0, 0.0, 47.4, 8.4, 600.0)
    with pytest.raises(ValueError, match=f"^a plan has rally points above home, and one of {name} is none$"):
        write_plan(FlightPlan(rally=[MissionItem(5100, place, frame=frame)]))
    assert read_plan(write_plan(FlightPlan(rally=[MissionItem(5100, place, frame=6)]))).rally[0].frame == 3
