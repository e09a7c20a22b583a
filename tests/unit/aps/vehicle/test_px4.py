"""How PX4 is flown: messages by hand, modes by pymavlink's own table and px4_custom_mode.h."""

import math
from dataclasses import replace
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from aps.callbacks import Callbacks
from aps.vehicle.autopilots.choice import autopilot_of
from aps.vehicle.commander import Commander
from aps.vehicle.commands.command_execution import CommandExecution
from aps.vehicle.execution import Outcome, Refusal
from aps.vehicle.flight import orbit, plans, targets
from aps.vehicle.missions import fly
from aps.vehicle.parameters.transfer import decoded, set_message
from aps.vehicle.state import VehicleState
from aps.vehicle.status_text import StatusText
from aps.vehicle.telemetry import Telemetry
from aps.wire.framer import Framer

S = 1_000_000_000
ACCEPTED, REJECTED, IN_PROGRESS = 0, 1, 5
HOVERS = VehicleState(
    sysid=3,
    vehicle_type=mavlink.MAV_TYPE_QUADROTOR,
    autopilot=12,
    time_boot_ms=60_000,
    mode="AUTO.LOITER",
    armed=True,
    landed_state="in_air",
    lat_deg=47.0,
    lon_deg=8.0,
    alt_amsl_m=508.0,
    alt_rel_m=20.0,
    position_ned_m=(1.0, 2.0, -20.0),
    velocity_ned_mps=(0.0, 0.0, 0.0),
    home_lat_deg=47.0,
    home_lon_deg=8.0,
    home_alt_amsl_m=488.0,
)
STANDS = replace(HOVERS, landed_state="on_ground", alt_rel_m=0.0)


def test_modes_are_those_of_pymavlink():
    """pymavlink has names for most: main mode, sub mode of AUTO."""
    ours = autopilot_of(12).modes(2)
    for name, (_, main, sub) in mavutil.px4_map.items():
        spelled = {"LOITER": "AUTO.LOITER", "MISSION": "AUTO.MISSION", "RTL": "AUTO.RTL", "LAND": "AUTO.LAND"}
        spelled |= {"READY": "AUTO.READY", "TAKEOFF": "AUTO.TAKEOFF", "FOLLOWME": "AUTO.FOLLOW_TARGET"}
        if name not in ("RTGS", "RATTITUDE"):  # left out of PX4
            assert ours[spelled.get(name, name)] == main << 16 | sub << 24
    assert len(set(ours.values())) == len(ours)


def test_names_of_ardupilot_and_of_qgroundcontrol_are_taken_and_said():
    plan = plans.set_mode(HOVERS, "guided")
    assert plan.reached(HOVERS)
    assert plan.remark == "GUIDED is AUTO.LOITER of PX4"
    assert plans.set_mode(HOVERS, "Return").reached(replace(HOVERS, mode="AUTO.RTL"))
    assert plans.set_mode(HOVERS, "OFFBOARD").remark == ""
    with pytest.raises(ValueError, match=r"mode 'SMART_RTL' is none of MANUAL, ALTCTL"):
        plans.set_mode(HOVERS, "SMART_RTL")


def test_heights_are_above_mean_sea_level():
    climb = plans.takeoff(STANDS, 15.0).steps[0].message(0)
    assert (climb.command, climb.param7) == (22, 503.0)
    assert all(map(math.isnan, (climb.param4, climb.param5, climb.param6)))
    goto = targets.goto(HOVERS, 47.001, 8.001, 30.0, speed_mps=4.0, yaw_deg=90.0).steps[0].message(0)
    assert (goto.command, goto.frame, goto.x, goto.y, goto.z) == (192, 5, 470010000, 80010000, 518.0)
    assert (goto.param1, goto.param2, goto.param4) == (4.0, 1.0, pytest.approx(math.pi / 2))
    amsl = targets.goto(HOVERS, 47.001, 8.001, 530.0, frame="amsl").steps[0].message(0)
    assert (amsl.z, amsl.param1) == (530.0, -1.0)
    assert math.isnan(amsl.param4)
    circle = orbit.orbit(HOVERS, 47.0, 8.0, 20.0, 15.0, 3.0, clockwise=False).steps[0].message(0)
    assert (circle.command, circle.param1, circle.param2, circle.z) == (34, -15.0, 3.0, 508.0)
    unknown = replace(HOVERS, home_alt_amsl_m=math.nan)
    assert targets.goto(unknown, 47.0, 8.0, 30.0).steps[0].message(0).z == 518.0, "by where it is itself"


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        (lambda: plans.takeoff(replace(STANDS, armed=False), 10.0), "not armed"),
        (lambda: plans.takeoff(HOVERS, 30.0), "flies already"),
        (lambda: targets.goto(replace(HOVERS, armed=False), 47.0, 8.0, 30.0), "not armed"),
        (lambda: targets.goto(HOVERS, 47.0, 8.0, 30.0, frame="terrain"), "no frame 'terrain'"),
        (lambda: targets.velocity(replace(HOVERS, vehicle_type=1), 1.0, 0.0), "for copters"),
        (lambda: plans.change_speed(HOVERS, 3.0, "climb"), "MPC_Z_VEL_MAX_UP"),
        (
            lambda: plans.takeoff(replace(STANDS, home_alt_amsl_m=math.nan, alt_amsl_m=math.nan), 10.0),
            "where home is, is not known",
        ),
    ],
)
def test_what_px4_does_not_do_is_refused_in_words(make, reason):
    with pytest.raises(Refusal, match=reason):
        make()


class Flight:
    """An execution, and the clocks."""

    def __init__(self, plan, state=HOVERS):
        self.execution, self.state, self.now_ns = CommandExecution(plan), state, 0
        self.sent = []

    def run(self, seconds, **changes):
        self.state = replace(self.state, **changes)
        for _ in range(round(seconds / 0.05)):
            self.now_ns += S // 20
            self.state = replace(self.state, time_boot_ms=self.state.time_boot_ms + 50)
            self.sent += [(self.now_ns / S, m) for m in self.execution.poll(self.state, self.now_ns)]

    def of(self, kind):
        return [at for at, message in self.sent if message.get_type() == kind]


def test_setpoints_lead_offboard_and_hold_follows_it():
    flight = Flight(targets.velocity(HOVERS, 1.0, 0.0, duration_s=2.0, rate_hz=1.0))
    flight.run(1.0)
    (asked,) = flight.of("COMMAND_LONG")
    assert asked == pytest.approx(0.55, abs=0.051)
    assert flight.execution.deadline_ns() > flight.now_ns
    flight.execution.on_ack(176, ACCEPTED)
    flight.run(2.2, mode="OFFBOARD")
    assert flight.execution.result.reached
    setpoints = flight.of("SET_POSITION_TARGET_LOCAL_NED")
    assert max(b - a for a, b in pairwise(setpoints)) < 0.5, "2 Hz at least"
    last = flight.sent[-1][1]
    assert (last.command, last.param2, last.param3) == (176, 4.0, 3.0)


def test_a_newer_velocity_does_not_wait_for_setpoints_anew():
    flight = Flight(targets.velocity(HOVERS, 1.0, 0.0))
    flight.run(0.4)
    newer = Flight(targets.velocity(HOVERS, 2.0, 0.0), flight.state)
    newer.now_ns = flight.now_ns
    newer.execution.setpoints.leads_on(flight.execution.setpoints)
    newer.run(0.25)
    assert len(newer.of("COMMAND_LONG")) == 1
    fresh = Flight(targets.velocity(HOVERS, 2.0, 0.0))
    fresh.run(0.25)
    assert fresh.of("COMMAND_LONG") == []


def test_a_moving_target_is_where_it_was_told_to_be_when_offboard_is_there():
    """2 m/s north for 1 s since the call; height above mean sea level."""
    flight = Flight(targets.follow(HOVERS, 47.0, 8.0, 22.0, north_mps=2.0))
    flight.run(1.05)
    first = flight.sent[0][1]
    last = [m for _, m in flight.sent if m.get_type().startswith("SET_")][-1]
    metres = (last.lat_int - first.lat_int) * 1e-7 * math.radians(6_378_137.0)
    assert metres == pytest.approx(2.0 * flight.of(last.get_type())[-1], abs=0.2)
    assert (first.coordinate_frame, first.alt) == (mavlink.MAV_FRAME_GLOBAL_INT, 510.0)


def test_what_the_navigator_objects_to_is_a_refusal():
    flight = Flight(targets.goto(HOVERS, 47.1, 8.0, 20.0))
    flight.run(0.1)
    flight.execution.on_ack(192, ACCEPTED)
    flight.run(0.1)
    flight.execution.on_text(StatusText(3, "Reposition is outside geofence"))
    flight.run(0.1)
    result = flight.execution.result
    assert (result.outcome, result.reason) == (Outcome.REFUSED, "Reposition is outside geofence")


@pytest.mark.parametrize(
    ("plan", "start", "command"),
    [
        (targets.goto(HOVERS, 47.1, 8.0, 20.0), HOVERS, 192),
        (plans.takeoff(STANDS, 20.0), STANDS, 22),
    ],
)
def test_a_fail_safe_that_holds_interrupts_what_ends_in_hold(plan, start, command):
    """As at a fence: GF_ACTION 2, PX4's default. The mode was, or would have become, AUTO.LOITER anyway."""
    flight = Flight(plan, start)
    flight.execution.on_text(StatusText(2, "Failsafe activated: switching to Hold"))  # of before
    flight.run(0.1)
    flight.execution.on_ack(command, ACCEPTED)
    flight.run(2.0)
    assert flight.execution.result is None
    flight.execution.on_text(StatusText(2, "Failsafe activated: switching to Hold"))
    flight.run(0.1)
    result = flight.execution.result
    assert (result.outcome, result.reason) == (Outcome.INTERRUPTED, "Failsafe activated: switching to Hold")


def test_where_a_link_is_lost_a_takeoff_stops_and_a_goto_flies_on():
    """NAV_DLL_ACT 1, as flown."""
    said = StatusText(2, "GCS connection loss: switching to Hold")
    takeoff, goto = Flight(plans.takeoff(STANDS, 20.0), STANDS), Flight(targets.goto(HOVERS, 47.1, 8.0, 20.0))
    for flight, command in ((takeoff, 22), (goto, 192)):
        flight.run(0.1)
        flight.execution.on_ack(command, ACCEPTED)
        flight.run(2.0)
        flight.execution.on_text(said)
        flight.run(0.1)
    assert takeoff.execution.result.reason == said.text
    assert goto.execution.result is None


def test_a_mission_goes_on_in_the_mode_of_its_last_item():
    start = replace(HOVERS, mission_current=0, mission_total=2)
    flight = Flight(fly.fly(start), start)
    flight.run(0.1)
    flight.execution.on_ack(176, ACCEPTED)
    flight.run(2.0, mode="AUTO.MISSION")
    flight.run(1.0, mode="AUTO.RTL", mission_current=1)  # MISSION_CURRENT comes later than the heartbeat
    assert flight.execution.result is None
    flight.run(20.0, mission_current=2)
    assert flight.execution.result is None
    flight.run(0.1, armed=False)
    assert flight.execution.result.reached


def test_a_planes_mission_that_ends_with_a_return_is_done_over_home():
    """PX4 reaches no item then and never says that it is complete: `RTL: completed, loitering`, and it circles."""
    start = replace(HOVERS, vehicle_type=mavlink.MAV_TYPE_FIXED_WING, mission_current=0, mission_total=3)
    flight = Flight(fly.fly(start), start)
    flight.run(0.1)
    flight.execution.on_ack(176, ACCEPTED)
    flight.run(2.0, mode="AUTO.MISSION")
    assert flight.execution.result is None, "over home on its way"
    flight.run(1.0, mission_current=3, mission_reached=2, lat_deg=47.005, heard_ns={46: 9 * S})
    flight.run(5.0, mode="AUTO.RTL")
    assert flight.execution.result is None, "it is 560 m away"
    flight.run(0.1, lat_deg=47.0007)
    assert flight.execution.result.reached


def at_its_last_item(landed_state):
    """A mission of three items that is flown to the last, as PX4 says it: once, and again every second."""
    start = replace(HOVERS, mission_current=0, mission_total=2, heard_ns={245: 1})
    flight = Flight(fly.fly(start), start)
    flight.run(0.1)
    flight.execution.on_ack(176, ACCEPTED)
    flight.run(2.0, mode="AUTO.MISSION", mission_current=2, mission_reached=1, heard_ns={46: S, 245: S})
    flight.run(0.1, mission_reached=2, heard_ns={46: 3 * S, 245: 3 * S})
    assert flight.execution.result is None, "whether it lands is not known yet"
    flight.run(1.0, landed_state=landed_state, heard_ns={46: 4 * S, 245: 4 * S})
    return flight


def test_a_mission_that_ends_with_a_landing_is_done_on_the_ground():
    """PX4 reaches NAV_LAND above the place, and stays in AUTO.MISSION while it sinks."""
    flight = at_its_last_item("landing")
    flight.run(20.0, heard_ns={46: 14 * S, 245: 25 * S})
    assert flight.execution.result is None
    flight.run(0.1, landed_state="on_ground")
    assert flight.execution.result.reached


def test_a_mission_of_a_ua_that_stands_where_the_one_before_has_ended_is_not_flown():
    """PX4 stays in AUTO.MISSION at the last item once it has disarmed."""
    start = replace(STANDS, armed=False, mode="AUTO.MISSION", mission_current=2, mission_total=2)
    flight = Flight(fly.fly(start), start)
    flight.run(0.1)
    flight.execution.on_ack(176, ACCEPTED)
    flight.run(3.2)
    assert flight.execution.result.reason == "the UA is not armed"


@pytest.mark.parametrize(("current", "is_done"), [(1, True), (2, False)])
def test_a_mission_whose_jumps_at_the_end_are_done_is_done(current, is_done):
    """PX4 goes on to hold from the item that it has reached; a pilot has it hold on the way to another."""
    start = replace(HOVERS, mission_current=0, mission_total=3)
    flight = Flight(fly.fly(start), start)
    flight.run(0.1)
    flight.execution.on_ack(176, ACCEPTED)
    flight.run(2.0, mode="AUTO.MISSION", mission_current=1, mission_reached=0, heard_ns={46: S})
    flight.run(1.0, mission_current=current, mission_reached=1, heard_ns={46: 3 * S})
    assert flight.execution.result is None
    flight.run(2.0, mode="AUTO.LOITER")
    assert flight.execution.result.reached is is_done


def test_a_mission_that_ends_in_the_air_is_done_with_its_last_item():
    assert at_its_last_item("in_air").execution.result.reached


@pytest.mark.parametrize(("last", "first"), [(0, None), (3, 3)])
def test_a_mission_from_its_last_item_flown_again_ends_with_it(last, first):
    """PX4 says neither a state of the mission nor, with one item, another number of it than after the flight before."""
    start = replace(
        HOVERS, mission_current=last, mission_total=last, mission_reached=last, heard_ns={46: 1 * S}
    )
    flight = Flight(fly.fly(start, first), start)
    for _ in range(2):
        flight.run(0.2)
        flight.execution.on_ack(176, ACCEPTED)
    flight.run(0.2, heard_ns={46: 2 * S})
    flight.run(1.0, mode="AUTO.MISSION", heard_ns={46: 3 * S})
    assert flight.execution.result is None, "what PX4 repeats until it begins is of the flight before"
    flight.run(0.1, heard_ns={46: 9 * S})
    assert flight.execution.result.reached


def test_a_mission_whose_landing_is_aborted_is_interrupted():
    """A plane without a distance sensor holds above the place (FW_LND_ABORT), which is how a mission may end."""
    start = replace(HOVERS, vehicle_type=mavlink.MAV_TYPE_FIXED_WING, mission_current=0, mission_total=3)
    flight = Flight(fly.fly(start), start)
    flight.run(0.1)
    flight.execution.on_ack(176, ACCEPTED)
    flight.run(2.0, mode="AUTO.MISSION", mission_current=3, mission_reached=2)
    flight.execution.on_text(StatusText(2, "Landing aborted: terrain measurement not found"))
    flight.run(1.0, mode="AUTO.LOITER")
    assert flight.execution.result.outcome is Outcome.INTERRUPTED
    assert flight.execution.result.reason == "Landing aborted: terrain measurement not found"


@pytest.mark.parametrize("mode", ["AUTO.MISSION", "AUTO.LOITER"])
def test_a_mission_flown_again_from_its_first_item_is_not_done_at_once(mode):
    """With the number of the item that it is set to, PX4 says once more that it has reached the last one."""
    start = replace(
        HOVERS, mode=mode, mission_current=3, mission_total=3, mission_reached=3, heard_ns={46: 1 * S}
    )
    flight = Flight(fly.fly(start, 0), start)
    flight.run(0.2)
    flight.run(0.2, mission_current=0, heard_ns={46: 2 * S})
    flight.execution.on_ack(176, ACCEPTED)
    flight.run(1.0, mode="AUTO.MISSION", heard_ns={0: 3 * S, 46: 2 * S})
    assert flight.execution.result is None
    flight.run(1.0, mission_current=3, mission_reached=2, heard_ns={0: 4 * S, 46: 4 * S})
    assert flight.execution.result is None
    flight.run(0.1, mission_reached=3, heard_ns={0: 5 * S, 46: 5 * S})
    assert flight.execution.result.reached


def test_a_mission_that_px4_still_looks_at_is_asked_for_again():
    """A try each quarter of a second, for a second; then the reasons of the last rejection count."""
    flight = CommandExecution(fly.fly(replace(HOVERS, mission_current=0, mission_total=2)))
    (first,) = flight.poll(HOVERS, 0)
    flight.on_text(StatusText(4, "no valid mission"))
    flight.on_ack(176, IN_PROGRESS)
    flight.on_ack(176, REJECTED)
    assert flight.poll(HOVERS, S // 10) == []
    assert flight.deadline_ns() == S // 10 + S // 4
    assert flight.poll(HOVERS, S // 10 + S // 4 - 1) == []
    (again,) = flight.poll(HOVERS, S // 10 + S // 4)
    assert again.to_dict() == first.to_dict()
    flight.on_ack(176, ACCEPTED)
    flight.poll(replace(HOVERS, mode="AUTO.MISSION"), S)
    assert [event.phase for event in flight.events] == ["feedback", "accepted"]


def test_a_mission_that_px4_goes_on_rejecting_is_refused_within_little_more_than_a_second():
    flight = CommandExecution(fly.fly(replace(HOVERS, mission_current=0, mission_total=2)))
    now_ns, tries = 0, 0
    while flight.result is None:
        assert now_ns <= 2 * S
        if flight.poll(HOVERS, now_ns):
            tries += 1
            flight.on_text(StatusText(4, f"no, says it at try {tries}"))
            flight.on_ack(176, REJECTED)
            flight.poll(HOVERS, now_ns)
        now_ns += S // 20
    assert (tries, flight.result.outcome) == (5, Outcome.REFUSED)  # at 0, 0.25, ... 1 s
    assert flight.result.reason == "TEMPORARILY_REJECTED: no, says it at try 5"


def test_a_mission_acknowledged_before_it_is_rejected_is_asked_for_again():
    """PX4 of July 2025 and later: its receiver acknowledges, then its commander rejects; heartbeats say so."""
    start = replace(HOVERS, mission_current=0, mission_total=2, heard_ns={0: S // 20})
    flight = Flight(fly.fly(start), start)
    flight.run(0.1)
    flight.execution.on_ack(176, ACCEPTED)
    flight.run(0.1, heard_ns={0: S // 5})
    assert (len(flight.sent), flight.execution.events) == (1, []), "that heartbeat may be of before"
    assert flight.now_ns < flight.execution.deadline_ns()
    flight.run(1.0)
    assert len(flight.sent) == 1, "no heartbeat said that it is in another mode"
    flight.run(0.3, heard_ns={0: 6 * S // 5})
    assert len(flight.sent) == 2
    flight.execution.on_ack(176, ACCEPTED)
    flight.run(0.1, mode="AUTO.MISSION")
    assert [event.phase for event in flight.execution.events] == ["accepted"]


def test_a_mission_acknowledged_that_px4_never_begins_is_refused():
    """Though PX4's mission says that it is complete, as it does after a takeoff."""
    start = replace(HOVERS, mission_current=0, mission_total=2, mission_state="COMPLETE")
    flight = Flight(fly.fly(start), start)
    asked = 0
    while flight.execution.result is None:
        assert flight.now_ns < 4 * S
        if len(flight.sent) > asked:
            asked += 1
            flight.execution.on_ack(176, ACCEPTED)
            flight.execution.on_text(StatusText(4, "Mission rejected"))
        flight.run(0.05, heard_ns={0: flight.now_ns // S * S})
    assert str(flight.execution.result) == "mission refused: TEMPORARILY_REJECTED: Mission rejected"
    assert asked == 2  # at 0 and 1.25 s: heartbeats come each second


def begun_from(mode):
    """A flight whose mission was acknowledged, and a heartbeat before that."""
    start = replace(HOVERS, mode=mode, mission_current=0, mission_total=2, heard_ns={0: S // 20})
    flight = Flight(fly.fly(start), start)
    flight.run(0.1)
    flight.execution.on_ack(176, ACCEPTED)
    flight.run(0.1)
    return flight


def test_a_takeoff_that_goes_on_to_hold_is_no_begun_mission():
    flight = begun_from("AUTO.TAKEOFF")
    flight.run(1.0, mode="AUTO.LOITER", heard_ns={0: S})
    assert flight.execution.events == []
    assert len(flight.of("COMMAND_LONG")) == 2, "it is asked for again"
    flight.execution.on_ack(176, ACCEPTED)
    flight.run(0.1, mode="AUTO.MISSION", heard_ns={0: 2 * S})
    assert [event.phase for event in flight.execution.events] == ["accepted"]


def test_a_pilot_who_takes_over_is_not_overruled():
    flight = begun_from("AUTO.LOITER")
    flight.run(3.0, mode="POSCTL", heard_ns={0: S})
    assert len(flight.of("COMMAND_LONG")) == 1
    assert str(flight.execution.result) == "mission interrupted: mode changed to POSCTL"


def test_a_mission_shorter_than_a_heartbeats_period_is_not_begun_again():
    flight = begun_from("AUTO.LOITER")
    flight.run(
        6.0, mission_state="COMPLETE", mission_reached=2, mission_current=2, heard_ns={0: S, 46: S // 2}
    )
    assert flight.execution.result.reached
    assert len(flight.of("COMMAND_LONG")) == 1


def test_a_mission_whose_mode_no_heartbeat_could_show_counts_as_acknowledged():
    start = replace(HOVERS, mission_current=0, mission_total=2)
    flight = Flight(fly.fly(start), start)
    flight.run(0.1)
    flight.execution.on_ack(176, ACCEPTED)
    flight.run(1.9)
    assert flight.execution.events == []
    flight.run(0.3)
    assert [event.phase for event in flight.execution.events] == ["accepted"]
    flight.run(7.0, mission_state="COMPLETE", heard_ns={0: flight.now_ns})
    assert flight.execution.result is None, "it was never in the mode of a mission"
    flight.run(4.0)
    result = flight.execution.result
    assert (result.outcome, result.reason) == (
        Outcome.TIMED_OUT,
        "accepted, but not begun within 10 s of autopilot time: AUTO.LOITER",
    )


def test_a_mission_that_is_in_the_mode_of_its_last_item_at_the_next_heartbeat_was_begun():
    """A return as its last item, and it is flown from there."""
    start = replace(HOVERS, mission_current=0, mission_total=3)
    flight = Flight(fly.fly(start, 3), start)
    for command in (None, 176):
        flight.run(0.2, mission_current=3)
        flight.execution.on_ack(command, ACCEPTED)
    flight.run(1.0, mode="AUTO.RTL", mission_state="COMPLETE", heard_ns={0: flight.now_ns + S // 2})
    assert flight.execution.result is None
    flight.run(5.0)
    assert flight.execution.result.reached
    assert [event.phase for event in flight.execution.events][:1] == ["accepted"]
    assert len(flight.of("COMMAND_LONG")) == 1, "it is not called back from its return"


def refused(commands, clock, after_s):
    """Why PX4 refuses a mission that is begun so long after the last word."""
    clock["now_ns"] += round(after_s * S)
    flight = commands.start("mission").execution
    while flight.result is None:
        commands.on_ack(flight.request, 176, REJECTED, 0xFF)
        clock["now_ns"] += S // 20
        commands.poll()
    assert flight.result.outcome is Outcome.REFUSED
    return flight.result.reason


def test_what_px4_said_to_the_upload_is_why_the_mission_is_refused():
    """It acknowledges the upload, then says once what is wrong with it; the mode of a mission it rejects in silence."""
    clock = {"now_ns": 0}
    commands = Commander(lambda: HOVERS, lambda *_: None, lambda: clock["now_ns"], lambda: None, Callbacks())
    commands.on_text(StatusText(3, "Battery unhealthy"))
    assert "does not say why" in refused(commands, clock, 0.0), "said before there was an upload"
    commands.start("mission_upload", [{"command": "NAV_WAYPOINT", "params": [0, 0, 0, 0, 47.0, 8.0, 20.0]}])
    commands.on_message("MISSION_REQUEST_INT", {"seq": 0, "mission_type": 0})
    clock["now_ns"] += S // 20
    commands.on_message("MISSION_ACK", {"type": 0, "mission_type": 0})
    assert not commands.busy
    for text in (
        StatusText(3, "Landing required"),
        StatusText(6, "chatter"),
        StatusText(3, "Landing required"),
    ):
        commands.on_text(text)
    assert refused(commands, clock, 0.1) == "TEMPORARILY_REJECTED: Landing required"
    assert "does not say why" in refused(commands, clock, 10.0), "long ago"


def test_words_at_an_earlier_try_count_where_the_last_is_in_silence():
    flight = CommandExecution(fly.fly(replace(HOVERS, mission_current=0, mission_total=2)))
    now_ns = 0
    flight.poll(HOVERS, now_ns)
    flight.on_text(StatusText(3, "Landing required"))
    while flight.result is None:
        flight.on_ack(176, REJECTED)
        now_ns += S // 20
        flight.poll(HOVERS, now_ns)
    assert flight.result.reason == "TEMPORARILY_REJECTED: Landing required"


def test_a_return_amid_a_mission_interrupts_it():
    start = replace(HOVERS, mission_current=0, mission_total=2)
    flight = Flight(fly.fly(start), start)
    flight.run(0.1)
    flight.execution.on_ack(176, ACCEPTED)
    flight.run(2.0, mode="AUTO.MISSION")
    flight.run(2.0, mode="AUTO.RTL")
    assert str(flight.execution.result) == "mission interrupted: mode changed to AUTO.RTL"


def test_another_item_is_set_by_a_message_that_the_state_answers():
    flight = Flight(fly.set_current(HOVERS, 2))
    flight.run(0.1)
    ((_, message),) = flight.sent
    assert (message.get_type(), message.seq) == ("MISSION_SET_CURRENT", 2)
    flight.run(0.1, mission_current=2)
    assert flight.execution.result.reached


RANGES = {
    1: (0, 255),
    2: (-128, 127),
    3: (0, 65535),
    4: (-32768, 32767),
    5: (0, 2**32 - 1),
    6: (-(2**31), 2**31 - 1),
}


@given(
    st.sampled_from(sorted(RANGES)).flatmap(lambda kind: st.tuples(st.just(kind), st.integers(*RANGES[kind])))
)
def test_whole_numbers_go_to_px4_and_back(number):
    """Two's complement, least byte first, the rest zeros: what Python's own conversion gives."""
    kind, value = number
    raw = bytes(set_message(7, "A", value, kind, 12).pack(mavlink.MAVLink(None)))[10:14]
    size = {1: 1, 2: 1, 3: 2, 4: 2, 5: 4, 6: 4}[kind]
    assert raw == value.to_bytes(size, "little", signed=RANGES[kind][0] < 0).ljust(4, b"\0")
    fields = {"param_type": kind, "param_value": 0.0, "param_bytes": raw}
    assert decoded(fields, 12) == value


@given(st.integers(0, 2**32 - 1))
def test_any_custom_mode_has_a_name(custom_mode):
    telemetry = Telemetry(1)
    heartbeat = mavlink.MAVLink_heartbeat_message(2, 12, 0x51, custom_mode, 3, 3)
    (frame,) = Framer().receive(bytes(heartbeat.pack(mavlink.MAVLink(None, 1, 1))))
    telemetry.update(frame, 0)
    name = telemetry.mode
    known = autopilot_of(12).modes(2)
    assert known.get(name, custom_mode) == custom_mode
    assert name in known or name == f"MODE_{custom_mode}"
