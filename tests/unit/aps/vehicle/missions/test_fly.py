from dataclasses import replace

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from aps.vehicle.commands.command_execution import CommandExecution
from aps.vehicle.execution import Outcome, Refusal
from aps.vehicle.missions import fly
from aps.vehicle.state import VehicleState
from tests.unit.aps.vehicle.flight.test_targets import COPTER

S = 1_000_000_000
AUTO = replace(COPTER, mode="AUTO", mission_current=1, mission_total=3, mission_state="ACTIVE")


def started(state=COPTER, **options):
    """A mission whose steps are all acknowledged; gives the execution and what was sent."""
    execution, sent = CommandExecution(fly.fly(state, **options)), []
    while messages := execution.poll(state, 0):
        sent += messages
        execution.on_ack(messages[0].command, 0)
    return execution, [(message.command, message.param1, message.param2) for message in sent]


def test_a_mission_is_done_when_the_autopilot_says_complete():
    execution, sent = started()
    assert sent == [(176, 1.0, 3.0), (300, 0.0, 0.0)]
    execution.poll(replace(AUTO, time_boot_ms=61_000), 1)
    assert execution.events[-1].text.startswith("AUTO, 20.0 m above home, item 1 of 3")
    assert (execution.events[-1].done, execution.events[-1].total) == (1, 3)
    execution.poll(replace(AUTO, time_boot_ms=62_000, mission_current=3), 2)
    assert execution.result is None
    execution.poll(replace(AUTO, time_boot_ms=63_000, mission_current=3, mission_state="COMPLETE"), 3)
    assert execution.result.reached


def test_complete_of_the_flight_before_is_not_this_ones():
    execution, _ = started(replace(COPTER, mission_state="COMPLETE"))
    execution.poll(replace(AUTO, time_boot_ms=61_000, mission_state="COMPLETE"), 1)
    assert execution.result is None
    execution.poll(replace(AUTO, time_boot_ms=66_000, mission_state="COMPLETE"), 2)
    assert execution.result.reached  # it was too short to be seen active


def test_a_mission_that_ends_with_a_landing_is_done_when_disarmed():
    execution, _ = started()
    execution.poll(AUTO, 1)
    execution.poll(replace(AUTO, mission_current=3, armed=False), 2)
    assert execution.result.reached


@pytest.mark.parametrize(("after_ms", "reached"), [(900, True), (2000, False)])
def test_a_mission_is_done_also_when_the_autopilot_is_back_at_its_first_item_before_it_says_disarmed(
    after_ms, reached
):
    """Real ArduCopter: MISSION_CURRENT and the heartbeat come at 1 Hz each, and any may be the first."""
    execution, _ = started()
    last = replace(AUTO, mission_current=3, time_boot_ms=90_000)
    execution.poll(last, 1)
    execution.poll(replace(last, mission_current=1, time_boot_ms=90_100), 2)
    assert execution.result is None
    execution.poll(replace(last, mission_current=1, armed=False, time_boot_ms=90_000 + after_ms), 3)
    assert execution.result.reached is reached


@pytest.mark.parametrize(("vtol", "mode"), [(False, "RTL"), (True, "RTL"), (True, "QRTL")])
def test_a_planes_mission_that_ends_with_a_return_is_done_over_home(vtol, mode):
    """ArduPlane enters RTL, a QuadPlane with Q_RTL_MODE 3 QRTL, says a second later that it is at that item, and flies
    on."""
    plane = replace(AUTO, vehicle_type=mavlink.MAV_TYPE_FIXED_WING, mission_current=2, vtol=vtol)
    plane = replace(plane, lat_deg=47.005, lon_deg=8.0, home_lat_deg=47.0, home_lon_deg=8.0)
    execution, _ = started(replace(plane, mode="GUIDED"))
    execution.poll(plane, 1)
    returns = replace(plane, mode=mode, time_boot_ms=plane.time_boot_ms + 1000)
    execution.poll(returns, 2)
    returns = replace(returns, mission_current=3, mission_state="PAUSED", time_boot_ms=90_000)
    execution.poll(returns, 3)
    assert execution.result is None, "it is 560 m away"
    execution.poll(replace(returns, lat_deg=47.001, time_boot_ms=91_000), 4)
    assert execution.result.reached


def test_a_planes_mission_that_ends_with_a_return_to_a_rally_point_is_done_there():
    plane = replace(AUTO, vehicle_type=mavlink.MAV_TYPE_FIXED_WING, mission_current=2)
    plane = replace(plane, lat_deg=47.0, lon_deg=8.0, home_lat_deg=47.0, home_lon_deg=8.0)
    execution, _ = started(replace(plane, mode="GUIDED"))
    execution.poll(plane, 1)
    returns = replace(plane, mode="RTL", mission_current=3, mission_state="PAUSED")
    execution.poll(replace(returns, waypoint_distance_m=1659.0, heard_ns={0: 1, 62: 2}), 2)
    assert execution.result is None, "it is over home"
    execution.poll(replace(returns, waypoint_distance_m=150.0, heard_ns={0: 1, 62: 3}), 3)
    assert execution.result.reached


def test_a_planes_return_amid_its_mission_interrupts_it():
    plane = replace(AUTO, vehicle_type=mavlink.MAV_TYPE_FIXED_WING)
    execution, _ = started(replace(plane, mode="GUIDED"))
    execution.poll(plane, 1)
    for after_ms in (100, 1700):
        execution.poll(replace(plane, mode="RTL", time_boot_ms=plane.time_boot_ms + after_ms), 2)
    assert execution.result.reason == "mode changed to RTL"


@pytest.mark.parametrize(
    ("mode", "after_s", "reason"),
    [
        ("GUIDED", 3, "mode changed to RTL"),
        ("RTL", 11, "accepted, but not begun within 10 s of autopilot time: RTL"),
    ],
)
def test_a_plane_without_a_mission_ends_it_with_its_return(mode, after_s, reason):
    """ArduPlane takes AUTO, and returns at once; a heartbeat shows that before MISSION_START is refused."""
    before = replace(COPTER, vehicle_type=mavlink.MAV_TYPE_FIXED_WING, mode=mode)
    empty = replace(before, mission_current=0, mission_total=0, mission_state="NO_MISSION")
    execution = CommandExecution(fly.fly(empty))
    for asked, shown in ((176, empty), (300, replace(empty, mode="RTL"))):
        execution.poll(shown, 0)
        execution.on_ack(asked, 0)
    for passed_s in range(after_s + 1):
        assert execution.result is None
        now = replace(empty, mode="RTL", time_boot_ms=empty.time_boot_ms + 1000 * passed_s)
        execution.poll(replace(now, heard_ns={0: passed_s * S}), passed_s * S)
    assert execution.result.reason == reason


def test_an_autopilot_that_never_says_complete_is_done_with_its_last_item():
    before = replace(COPTER, mission_reached=3, heard_ns={46: 5})
    execution, _ = started(before)
    execution.poll(replace(AUTO, mission_current=3, mission_reached=3, heard_ns={46: 5}), 1)
    assert execution.result is None  # that was the flight before
    execution.poll(replace(AUTO, mission_current=3, mission_reached=2, heard_ns={46: 6}), 2)
    assert execution.result is None
    execution.poll(replace(AUTO, mission_current=3, mission_reached=3, heard_ns={46: 7}), 3)
    assert execution.result.reached


@pytest.mark.parametrize(
    ("changes", "reason"),
    [({"mode": "LOITER"}, "mode changed to LOITER"), ({"armed": False}, "the UA is not armed")],
)
def test_leaving_auto_interrupts(changes, reason):
    execution, _ = started()
    execution.poll(AUTO, 1)
    execution.poll(replace(AUTO, **changes), 2)
    assert (execution.result.outcome, execution.result.reason) == (Outcome.INTERRUPTED, reason)


def test_it_begins_with_the_item_that_is_asked_for():
    _, sent = started(first=2)
    assert sent[0] == (mavlink.MAV_CMD_DO_SET_MISSION_CURRENT, 2.0, 0.0)


@pytest.mark.parametrize(("autopilot", "there"), [(3, {0, 1}), (12, {0})])
def test_home_as_the_item_to_go_on_with_is_ardupilots_first(autopilot, there):
    """AP_Mission::set_current_cmd goes on with item 1, and says so."""
    plan = fly.set_current(replace(AUTO, autopilot=autopilot), 0)
    reached = {
        seq for seq in range(4) if plan.reached(replace(AUTO, autopilot=autopilot, mission_current=seq))
    }
    assert reached == there


def test_set_current_is_done_when_the_autopilot_is_there():
    plan = fly.set_current(AUTO, 2)
    assert not plan.reached(AUTO)
    assert plan.reached(replace(AUTO, mission_current=2))
    with pytest.raises(ValueError, match="whole number"):
        fly.set_current(AUTO, 1.5)
    with pytest.raises(Refusal, match="mission is known of ArduPilot and PX4 alone"):
        fly.fly(VehicleState(sysid=1))
