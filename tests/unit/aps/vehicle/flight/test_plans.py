import math
from dataclasses import replace

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from aps.vehicle.commands.command_execution import CommandExecution
from aps.vehicle.execution import Refusal
from aps.vehicle.flight import plans, targets
from aps.vehicle.missions.fly import fly
from aps.vehicle.telemetry import VehicleState

COPTER = VehicleState(
    sysid=1,
    vehicle_type=mavlink.MAV_TYPE_QUADROTOR,
    autopilot=3,
    lat_deg=47.0,
    lon_deg=8.0,
    alt_rel_m=20.0,
    armed=True,
)
PLANE = replace(COPTER, vehicle_type=mavlink.MAV_TYPE_FIXED_WING)
VTOL = replace(COPTER, vehicle_type=20)
QUADPLANE = replace(PLANE, vtol=True)
"""As ArduPlane comes with Q_ENABLE: a fixed wing by its heartbeat."""


def first_messages(plan):
    return [step.message(0) for step in plan.steps]


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: plans.set_mode(COPTER, "FBWA"), "mode 'FBWA' is none of STABILIZE, ACRO"),
        (lambda: plans.set_mode(VehicleState(sysid=1), "GUIDED"), "no modes are known for MAV_TYPE 0"),
        (lambda: plans.takeoff(COPTER, 0.0), r"alt_rel_m must be in 0\.5\.\.10000, not 0\.0"),
        (lambda: plans.takeoff(COPTER, math.nan), "alt_rel_m must be in .*, not nan"),
        (lambda: targets.goto(COPTER, 91.0, 8.0, 20.0), r"lat_deg must be in -90\.\.90, not 91\.0"),
        (lambda: targets.goto(COPTER, 47.0, 181.0, 20.0), r"lon_deg must be in -180\.\.180, not 181\.0"),
        (lambda: targets.goto(COPTER, 47.0, 8.0, 20.0, 0.0), r"speed_mps must be in 0\.1\.\.200, not 0\.0"),
    ],
)
def test_mistakes_of_the_caller_raise(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def test_mode_names_in_any_case():
    (message,) = first_messages(plans.set_mode(PLANE, "fbwa"))
    assert (message.command, message.param1, message.param2) == (176, 1, 5)


def test_fixed_wing_takes_off_in_its_own_mode():
    plan = plans.takeoff(PLANE, 60.0)
    parameter, mode = first_messages(plan)
    assert (parameter.get_type(), parameter.param_id, parameter.param_value) == (
        "PARAM_SET",
        "TKOFF_ALT",
        60.0,
    )
    assert (mode.command, mode.param2) == (176, 13)
    execution = CommandExecution(plan)
    execution.poll(PLANE, 0)
    execution.steps.on_parameter("TKOFF_DIST", 60.0)
    assert execution.poll(PLANE, 1) == []
    execution.steps.on_parameter("TKOFF_ALT", 50.0)  # the old value, asked for by somebody else
    assert execution.poll(PLANE, 1) == []
    execution.steps.on_parameter("TKOFF_ALT", 60.0)
    (sent,) = execution.poll(PLANE, 2)
    assert sent.get_type() == "COMMAND_LONG"


@pytest.mark.parametrize("kind", [COPTER, PLANE, VTOL, QUADPLANE])
@pytest.mark.parametrize("landed_state", ["takeoff", "in_air", "landing"])
def test_who_flies_is_refused_a_takeoff_before_anything_is_sent(kind, landed_state):
    with pytest.raises(Refusal, match="it flies already"):
        plans.takeoff(replace(kind, landed_state=landed_state), 60.0)
    plans.takeoff(replace(kind, landed_state="on_ground"), 60.0)


@pytest.mark.parametrize("vtol", [VTOL, QUADPLANE])
def test_a_quadplane_that_stands_in_qloiter_takes_off_though_it_says_that_it_flies(vtol):
    stands = replace(vtol, mode="QLOITER", landed_state="in_air", alt_rel_m=-0.04)
    assert [message.command for message in first_messages(plans.takeoff(stands, 30.0))] == [176, 22]


@pytest.mark.parametrize("vtol", [VTOL, QUADPLANE])
def test_vtol_takes_off_in_guided_and_lands_in_qland(vtol):
    assert [message.command for message in first_messages(plans.takeoff(vtol, 30.0))] == [176, 22]
    (land,) = first_messages(plans.land(vtol))
    assert land.param2 == 20


@pytest.mark.parametrize("vtol", [VTOL, QUADPLANE])
def test_a_quadplane_has_returned_when_it_circles_and_may_go_on_to_qrtl(vtol):
    plan = plans.rtl(replace(vtol, home_lat_deg=47.0, home_lon_deg=8.0))
    assert plan.modes == ("RTL", "QRTL")
    flying = replace(vtol, mode="RTL", home_lat_deg=47.0, home_lon_deg=8.0, landed_state="in_air")
    assert plan.reached(replace(flying, lat_deg=47.0013))
    assert not plan.reached(replace(flying, lat_deg=47.0020))
    assert fly(vtol).launches


@pytest.mark.parametrize(
    ("state", "mode", "held"),
    [
        (QUADPLANE, "QHOVER", "QHOVER"),
        (VTOL, "QLOITER", "QLOITER"),
        (PLANE, "LOITER", ""),
        (COPTER, "LOITER", "LOITER"),
    ],
)
def test_the_stick_is_held_where_it_gives_the_climb_rate(state, mode, held):
    assert plans.set_mode(state, mode).stick_mode == held


def test_a_fixed_wing_that_lands_has_the_time_of_its_way_home():
    # AUTOLAND flies there first: 55 km are 37 minutes at 25 m/s.
    home = {"home_lat_deg": 47.5, "home_lon_deg": 8.0}
    assert plans.land(replace(PLANE, **home)).timeout_s > 2 * 55_600 / 25.0
    assert plans.land(replace(COPTER, **home)).timeout_s == 900.0


def test_fixed_wing_is_there_when_it_circles():
    goto = targets.goto(PLANE, 47.0, 8.0, 20.0)
    circling = replace(PLANE, lat_deg=47.0013)  # 145 m: the Aerosonde circles at 120 m
    assert goto.reached(circling)
    assert not goto.reached(replace(PLANE, lat_deg=47.0020))  # 223 m
    rtl = plans.rtl(replace(PLANE, home_lat_deg=47.0, home_lon_deg=8.0))
    assert rtl.reached(replace(circling, home_lat_deg=47.0, home_lon_deg=8.0))


def test_arduplane_has_returned_where_it_says_that_it_circles():
    """To a rally point, in place of home; what it said before was of another way point."""
    over_home = replace(PLANE, home_lat_deg=47.0, home_lon_deg=8.0, waypoint_distance_m=60.0)
    over_home = replace(over_home, heard_ns={0: 1, 62: 2})
    rtl = plans.rtl(over_home)
    assert not rtl.reached(over_home), "no heartbeat shows RTL"
    returns = replace(over_home, mode="RTL", heard_ns={0: 3, 62: 2})
    assert not rtl.reached(returns)
    assert rtl.remaining_m(returns) is None
    returns = replace(returns, waypoint_distance_m=1659.0, heard_ns={0: 3, 62: 4}, alt_rel_m=0.0)
    assert not rtl.reached(returns)
    assert rtl.remaining_m(returns) == 1659.0
    assert rtl.reached(replace(returns, lat_deg=47.0149, waypoint_distance_m=150.0, heard_ns={0: 5, 62: 6}))


def test_arduplane_that_returns_home_is_there_by_its_position_which_comes_more_often():
    plane = replace(PLANE, home_lat_deg=47.0, home_lon_deg=8.0, mode="RTL", groundspeed_mps=25.0)
    plane = replace(plane, lat_deg=47.0019, waypoint_distance_m=225.0, heard_ns={0: 1, 62: 2})
    rtl = plans.rtl(plane)
    assert not rtl.reached(plane)
    assert rtl.remaining_m(plane) == pytest.approx(math.hypot(211.5, 20.0), abs=0.1)
    assert rtl.reached(replace(plane, lat_deg=47.0017))


def test_goal_beyond_the_date_line_is_near():
    state = replace(COPTER, lat_deg=0.0, lon_deg=179.99999)
    assert plans.horizontal_distance_m(state, 0.0, -179.99999) == pytest.approx(2.226, abs=0.01)


def test_distance_of_one_degree_of_latitude():
    assert plans.horizontal_distance_m(COPTER, 46.0, 8.0) == pytest.approx(111_319.5, abs=0.1)


def test_forced_disarm_carries_the_magic_number():
    assert first_messages(plans.disarm(COPTER))[0].param2 == 0
    assert first_messages(plans.disarm(COPTER, force=True))[0].param2 == 21196


def test_unknown_home_is_no_distance():
    assert plans.rtl(COPTER).remaining_m(COPTER) is None
    assert math.isfinite(plans.rtl(COPTER).timeout_s)
