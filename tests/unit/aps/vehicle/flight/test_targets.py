import math
from dataclasses import replace

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from aps.vehicle.commands.command_execution import CommandExecution
from aps.vehicle.execution import Outcome, Refusal
from aps.vehicle.flight import orbit, plans, targets
from aps.vehicle.flight.setpoints import offset_deg
from aps.vehicle.state import VehicleState
from aps.vehicle.status_text import StatusText
from aps.wire.framer import Framer
from tests.unit.aps.vehicle.peer import Bench

S = 1_000_000_000
COPTER = VehicleState(
    sysid=1,
    vehicle_type=mavlink.MAV_TYPE_QUADROTOR,
    autopilot=3,
    time_boot_ms=60_000,
    mode="GUIDED",
    armed=True,
    lat_deg=47.0,
    lon_deg=8.0,
    alt_rel_m=20.0,
    alt_amsl_m=420.0,
    yaw_rad=math.pi / 2,
    position_ned_m=(10.0, 20.0, -20.0),
)
PLANE = replace(COPTER, vehicle_type=mavlink.MAV_TYPE_FIXED_WING)


class Flight:
    """A plan carried out, with what it has sent."""

    def __init__(self, plan, state=COPTER):
        self.execution, self.state, self.now_ns = CommandExecution(plan), state, 0

    def after(self, seconds, **changes):
        """Messages that are sent when so much time has passed on both clocks."""
        self.now_ns += round(seconds * S)
        passed_ms = self.state.time_boot_ms + round(seconds * 1000)
        self.state = replace(self.state, time_boot_ms=passed_ms, **changes)
        return self.execution.poll(self.state, self.now_ns)


def test_velocity_is_repeated_at_its_rate_and_ends_with_a_stop():
    flight = Flight(targets.velocity(COPTER, 3.0, -4.0, 1.0, duration_s=1.0, rate_hz=4.0))
    sent = [message for _ in range(30) for message in flight.after(0.05)]
    assert flight.execution.result.reached
    moves, stop = sent[:-1], sent[-1]
    assert len(moves) == 4
    for message in moves:
        assert (message.vx, message.vy, message.vz) == (3.0, -4.0, 1.0)
        # Only the velocity counts: no position, acceleration, yaw or its rate.
        assert message.type_mask == 0b1101_1100_0111
        assert message.coordinate_frame == mavlink.MAV_FRAME_LOCAL_NED
    assert (stop.vx, stop.vy, stop.vz) == (0.0, 0.0, 0.0)


def test_setpoints_keep_their_rate_in_a_simulation_faster_than_the_clock():
    execution = CommandExecution(targets.velocity(COPTER, 1.0, 0.0, duration_s=10.0, rate_hz=5.0))
    sent = []
    for ms in range(0, 9_950, 50):  # 200 times faster: 10 s of flight in 50 ms
        sent += execution.poll(replace(COPTER, time_boot_ms=60_000 + ms), ms * 5_000)
    assert len(sent) == 50


@pytest.mark.parametrize(
    ("frame", "mav_frame"), [("ned", mavlink.MAV_FRAME_LOCAL_NED), ("body", mavlink.MAV_FRAME_BODY_NED)]
)
def test_velocity_with_yaw_rate_in_either_frame(frame, mav_frame):
    [message] = Flight(targets.velocity(COPTER, 1.0, 0.0, yaw_rate_dps=90.0, frame=frame)).after(0.0)
    assert message.coordinate_frame == mav_frame
    assert message.type_mask == 0b0101_1100_0111
    assert message.yaw_rate == pytest.approx(math.pi / 2)


def test_a_velocity_ahead_with_a_heading_is_sent_as_north_and_east():
    """In BODY_NED the yaw would be a turn from where the nose is: repeated, ArduCopter turned on and on."""
    flight = Flight(targets.velocity(COPTER, 2.0, 1.0, -0.5, yaw_deg=90.0, frame="body"))
    [message] = flight.after(0.0)
    assert message.coordinate_frame == mavlink.MAV_FRAME_LOCAL_NED
    assert (message.vx, message.vy, message.vz) == pytest.approx((-1.0, 2.0, -0.5))
    assert message.yaw == pytest.approx(math.pi / 2)
    [message] = flight.after(0.2, yaw_rad=math.pi)
    assert (message.vx, message.vy) == pytest.approx((-2.0, -1.0))


def test_from_another_mode_guided_comes_first():
    loiter = replace(COPTER, mode="LOITER")
    flight = Flight(targets.velocity(loiter, 1.0, 0.0), loiter)
    [mode] = flight.after(0.0)
    assert (mode.command, mode.param2) == (176, 4)
    flight.execution.on_ack(176, 0)
    [message] = flight.after(0.1, mode="GUIDED")
    assert message.vx == 1.0
    assert flight.after(0.3, mode="LOITER") == []
    assert flight.execution.result.outcome is Outcome.INTERRUPTED


@pytest.mark.parametrize(
    ("frame", "expected"),
    [("origin", (1.0, 2.0, -3.0)), ("offset", (11.0, 22.0, -23.0)), ("body", (8.0, 21.0, -23.0))],
)
def test_local_points_of_each_frame_are_sent_as_metres_from_the_origin(frame, expected):
    """The nose points east: a metre ahead is a metre east, two to the right are two south."""
    flight = Flight(targets.goto_ned(COPTER, 1.0, 2.0, -3.0, frame=frame))
    message, asked = flight.after(0.0)
    assert (message.x, message.y, message.z) == pytest.approx(expected)
    assert message.type_mask == 0b1101_1111_1000
    assert (asked.command, asked.param1) == (512, 85.0)  # what it flies to
    assert flight.after(0.4) == []
    assert len(flight.after(0.7)) == 2  # repeated, as nobody acknowledges it
    flight.after(0.1, position_ned_m=expected)
    assert flight.execution.result.reached


GOAL = (60.0, 20.0, -20.0)


def echo(place=GOAL, type_mask=0b1101_1111_1000):
    return dict(zip("xyz", place, strict=True)) | {"type_mask": type_mask}


def flown_by_setpoints(echoes, seconds=12, goal=GOAL, to_go_m=0.0, speed_mps=0.0):
    """A second each; what the autopilot says that it flies to, just after it is asked."""
    state = replace(COPTER, waypoint_distance_m=to_go_m, groundspeed_mps=speed_mps)
    flight = Flight(targets.goto_ned(COPTER, *goal), state)
    asked = 0
    for said in [*echoes, *[None] * (seconds - len(echoes))]:
        asked += len(flight.after(1.0)) - 1 if flight.execution.result is None else 0
        if said is not None:
            flight.execution.on_message("POSITION_TARGET_LOCAL_NED", said, flight.now_ns)
    flight.after(0.05)
    return flight.execution.result, asked


@pytest.mark.parametrize(
    "other",
    [echo((10.0, 20.0, -20.0)), echo((60.0, 20.0, -21.0)), echo(type_mask=0b1101_1100_0111)],
    ids=["the point before", "another height", "a velocity"],
)
def test_a_local_point_that_arducopter_drops_is_refused_in_words(other):
    """It drops one beyond its fence (ModeGuided::set_destination), and flies on to what it had."""
    assert flown_by_setpoints([other] * 4, seconds=4) == (None, 4), "setpoints may get lost"
    result, _ = flown_by_setpoints([other] * 5)
    assert (result.outcome, result.reason) == (
        Outcome.REFUSED,
        "the autopilot does not take this point: ArduCopter flies to no point beyond its fence, and does not say so",
    )


@pytest.mark.parametrize("said", [(0.0, 0.0, 0.0), (10.0, 20.0, -20.0)])
@pytest.mark.parametrize(("to_go_m", "speed_mps"), [(50.0, 0.0), (48.0, 0.0), (58.0, 5.0)])
def test_a_point_that_arducopter_flies_to_though_it_says_another_is_not_refused(said, to_go_m, speed_mps):
    """With GUID_OPTIONS 64 it says one of before."""
    told = flown_by_setpoints([echo(said)] * 10, to_go_m=to_go_m, speed_mps=speed_mps)
    assert told == (None, 10)


@pytest.mark.parametrize("to_go_m", [47.0, 53.0])
def test_a_way_to_go_that_is_not_to_the_point_is_to_another(to_go_m):
    result, _ = flown_by_setpoints([echo((10.0, 20.0, -20.0))] * 5, to_go_m=to_go_m)
    assert result.outcome is Outcome.REFUSED


def test_a_point_above_the_one_before_that_arducopter_drops_is_refused():
    result, _ = flown_by_setpoints([echo((10.0, 20.0, -20.0))] * 5, goal=(10.0, 20.0, -200.0))
    assert result.outcome is Outcome.REFUSED


def test_a_local_point_that_was_taken_is_flown_to_whatever_is_said_later():
    assert flown_by_setpoints([echo((10.0, 20.0, -20.0)), echo(), *[echo((0.0, 0.0, 0.0))] * 8]) == (None, 2)


def test_an_autopilot_that_does_not_say_what_it_flies_to_is_asked_a_few_times():
    assert flown_by_setpoints([]) == (None, 10)


@pytest.mark.parametrize(
    ("changes"), [{"vehicle_type": mavlink.MAV_TYPE_GROUND_ROVER}, {"autopilot": mavlink.MAV_AUTOPILOT_PX4}]
)
def test_only_arducopter_is_asked_whether_it_takes_a_local_point(changes):
    assert targets.goto_ned(replace(COPTER, **changes), 1.0, 2.0, -3.0).echo is None


def test_a_speed_goes_with_the_first_setpoints_of_a_local_point():
    """ArduCopter's GUIDED begins with its own speed (ModeGuided::pva_control_start); setpoints may get lost."""
    flight = Flight(targets.goto_ned(COPTER, *GOAL, speed_mps=12.0))
    sent = [flight.after(1.0 if turn else 0.0) for turn in range(7)]
    assert [[m.command for m in messages[1:]] for messages in sent] == [[178, 512]] * 5 + [[512]] * 2
    setpoint, speed, _ = sent[0]
    assert setpoint.get_type() == "SET_POSITION_TARGET_LOCAL_NED"
    assert (speed.param1, speed.param2, speed.param3) == (1.0, 12.0, -1.0)
    with pytest.raises(ValueError, match=r"speed_mps must be in 0\.1"):
        targets.goto_ned(COPTER, *GOAL, speed_mps=0.0)


def test_a_local_point_with_a_speed_is_a_reposition_of_px4():
    """In OFFBOARD it flies as fast as MPC_XY_VEL_MAX."""
    state = replace(COPTER, autopilot=mavlink.MAV_AUTOPILOT_PX4)
    (sent,) = Flight(targets.goto_ned(state, 110.0, 20.0, -30.0, speed_mps=4.0, yaw_deg=90.0), state).after(
        0.0
    )
    assert (sent.command, sent.param1, sent.z) == (192, 4.0, 430.0)
    assert sent.param4 == pytest.approx(math.pi / 2)
    north, east = offset_deg(47.0, 8.0, 100.0, 0.0)
    assert (sent.x, sent.y) == (round(north * 1e7), round(east * 1e7))
    with pytest.raises(Refusal, match="yaw_rate_dps"):
        targets.goto_ned(state, *GOAL, speed_mps=4.0, yaw_rate_dps=10.0)
    with pytest.raises(Refusal, match="not known yet"):
        targets.goto_ned(replace(state, lat_deg=math.nan), *GOAL, speed_mps=4.0)
    assert targets.goto_ned(state, *GOAL).setpoint is not None


def test_a_local_point_from_nowhere_is_refused():
    with pytest.raises(Refusal, match="where it is is not known"):
        targets.goto_ned(replace(COPTER, position_ned_m=(math.nan,) * 3), 1.0, 0.0, 0.0, frame="offset")


@pytest.mark.parametrize(
    ("frame", "mav_frame", "there"),
    [
        ("relative", 3, {"alt_rel_m": 50.0}),
        ("amsl", 0, {"alt_amsl_m": 50.0}),
        ("terrain", 10, {}),
    ],
)
def test_heights_of_goto_count_from_what_the_frame_says(frame, mav_frame, there):
    plan = targets.goto(COPTER, 47.0, 8.0, 50.0, frame=frame, yaw_deg=-90.0)
    _, reposition, yaw = [step.message(0) for step in plan.steps]
    assert (reposition.frame, reposition.z) == (mav_frame, 50.0)
    assert (yaw.command, yaw.param1) == (mavlink.MAV_CMD_CONDITION_YAW, 270.0)
    assert plan.reached(COPTER) is (frame == "terrain")
    assert plan.reached(replace(COPTER, **there))


@pytest.mark.parametrize(
    ("height_m", "frame", "is_why"),
    [(0.0, "relative", True), (-0.004, "terrain", True), (0.1, "relative", False), (0.0, "amsl", False)],
)
def test_a_height_of_0_is_why_arducopter_denies_a_goto(height_m, frame, is_why):
    """Location::sanitize takes it for the present height, and GUIDED denies what that has changed."""
    plan = targets.goto(COPTER, 47.0, 8.0, height_m, frame=frame)
    assert plan.refusal_hint.startswith("ArduPilot takes a height of 0 for the present one") is is_why


def test_a_followed_target_moves_between_the_calls():
    flight = Flight(targets.follow(COPTER, 47.0, 8.0, 30.0, north_mps=10.0, down_mps=-1.0, duration_s=2.0))
    [first] = flight.after(0.0)
    [later] = flight.after(1.5)
    assert (first.lat_int, first.alt) == (470_000_000, 30.0)
    assert later.lat_int - 470_000_000 == pytest.approx(15.0 / 6_378_137.0 / math.pi * 180e7, abs=1)
    assert (later.alt, later.vx, later.vz) == (31.5, 10.0, -1.0)
    assert later.type_mask == 0b1101_1100_0000
    [stop] = flight.after(0.5)
    assert (stop.get_type(), stop.vx) == ("SET_POSITION_TARGET_LOCAL_NED", 0.0)
    assert flight.execution.result.reached


def test_an_orbit_leads_around_the_circle_and_counts_its_turns():
    plan = orbit.orbit(COPTER, 47.0, 8.0, 20.0, radius_m=50.0, speed_mps=5.0, turns=1.0, clockwise=False)
    flight = Flight(plan)
    for step in range(800):
        bearing = -step * 0.01  # counter-clockwise, 0.5 m at a time
        lat, lon = offset_deg(47.0, 8.0, 50.0 * math.cos(bearing), 50.0 * math.sin(bearing))
        messages = flight.after(0.1, lat_deg=lat, lon_deg=lon)
        if flight.execution.result is not None:
            break
        [message] = messages
        north_m = math.radians(message.lat_int * 1e-7 - 47.0) * 6_378_137.0
        east_m = math.radians(message.lon_int * 1e-7 - 8.0) * 6_378_137.0 * math.cos(math.radians(47.0))
        assert math.hypot(north_m, east_m) == pytest.approx(50.0, abs=0.1)
        assert math.hypot(message.vx, message.vy) == pytest.approx(5.0, abs=1e-3)
        assert message.vx * north_m + message.vy * east_m == pytest.approx(0.0, abs=5.0)
        # Counter-clockwise: centre to point, cross velocity, points up (negative down).
        assert north_m * message.vy - east_m * message.vx < 0.0
        # The nose looks at the centre.
        assert math.cos(message.yaw - math.atan2(-east_m, -north_m)) > 0.999
    assert flight.execution.result.reached
    assert step == math.ceil(math.tau / 0.01)


@pytest.mark.parametrize("clockwise", [True, False])
def test_a_planes_orbit_is_its_own(clockwise):
    plan = orbit.orbit(PLANE, 47.0, 8.0, 90.0, radius_m=120.0, clockwise=clockwise)
    _, reposition = [step.message(0) for step in plan.steps]
    # ArduPlane passes over a radius below 0, and circles to the left with a yaw (handle_command_int_do_reposition).
    assert (reposition.command, reposition.param3, reposition.z) == (192, 120.0, 90.0)
    assert math.isnan(reposition.param4) if clockwise else reposition.param4 == 1.0
    assert plan.setpoint is None


@pytest.mark.parametrize("make", [targets.velocity, targets.goto_ned])
def test_a_plane_takes_no_setpoints(make):
    with pytest.raises(Refusal, match="ArduPlane takes no setpoints"):
        make(PLANE, 1.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda: targets.velocity(COPTER, math.nan, 0.0), "north_mps must be in"),
        (lambda: targets.velocity(COPTER, 1.0, 0.0, rate_hz=0.5), "rate_hz must be in 1..50"),
        (lambda: targets.velocity(COPTER, 1.0, 0.0, frame="enu"), "frame 'enu' is none of ned, body"),
        (lambda: targets.velocity(COPTER, 1.0, 0.0, yaw_deg=1.0, yaw_rate_dps=1.0), "exclude each other"),
        (lambda: targets.goto(COPTER, 47.0, 8.0, 5.0, frame="agl"), "none of relative, amsl, terrain"),
        (lambda: targets.goto(PLANE, 47.0, 8.0, 5.0, yaw_deg=0.0), "a plane points where it flies"),
        (lambda: targets.follow(COPTER, 147.0, 8.0, 5.0), "lat_deg must be in"),
        (lambda: targets.goto(COPTER, 0.0, 0.0, 5.0), "both 0, which names no place"),
        (lambda: targets.goto(COPTER, 1e-9, -1e-9, 5.0), "both 0, which names no place"),
        (lambda: targets.follow(COPTER, 0.0, 0.0, 5.0), "both 0, which names no place"),
        (lambda: orbit.orbit(COPTER, 0.0, 0.0, 5.0, radius_m=9.0), "both 0, which names no place"),
        (lambda: orbit.orbit(COPTER, 47.0, 8.0, 5.0, radius_m=1.0), "radius_m must be in 2..10000"),
        (lambda: plans.change_speed(COPTER, 5.0, "warp"), "kind 'warp' is none of"),
    ],
)
def test_mistakes_of_the_caller_raise(call, text):
    with pytest.raises(ValueError, match=text):
        call()


def guided():
    bench = Bench()
    bench.tell(mavlink.MAVLink_heartbeat_message(2, 3, 0x51 | 0x80, 4, 4, 3))
    bench.step()
    return bench


def test_a_newer_target_supersedes_and_another_command_interrupts():
    bench = guided()
    ends = []
    for verb, arguments in (
        ("goto", (47.0, 8.0, 20.0)),
        ("goto", (47.1, 8.0, 20.0)),
        ("velocity", (1.0, 0.0)),
        ("speed", (5.0,)),
        ("rtl", ()),
    ):
        bench.commands.start(verb, *arguments, on_done=lambda result: ends.append(str(result)))
    assert ends == [
        "goto superseded: by goto",
        "goto superseded: by velocity",
        "velocity interrupted: by rtl",
    ]


FLOWN = (
    ("velocity", (1.0, 0.0)),
    ("follow", (47.0, 8.0, 20.0)),
    ("goto", (47.0, 8.0, 20.0)),
    ("goto_ned", (1.0, 2.0, -3.0)),
    ("orbit", (47.0, 8.0, 20.0, 10.0)),
)


def heartbeat(*, armed):
    return mavlink.MAVLink_heartbeat_message(2, 3, 0x51 | (0x80 if armed else 0), 4, 4, 3)


def ends_of(bench, commands):
    ends = []
    for verb, arguments in commands:
        bench.commands.start(verb, *arguments, on_done=lambda result: ends.append(str(result)))
    return ends


def test_targets_for_a_ua_that_is_told_to_be_disarmed_are_interrupted_at_once_and_nothing_is_sent():
    bench = guided()
    first = ends_of(bench, FLOWN[:1])
    bench.tell(heartbeat(armed=False))
    assert first == ["velocity interrupted: the UA is not armed"]
    bench.step()
    heard = len(bench.autopilot.heard)
    assert ends_of(bench, FLOWN) == [f"{verb} interrupted: the UA is not armed" for verb, _ in FLOWN]
    bench.step()
    assert len(bench.autopilot.heard) == heard
    assert ends_of(bench, [("hold", ())]) == [], "which one may that stands"


def test_a_plane_that_is_told_to_be_disarmed_is_not_left_in_a_mode_in_which_it_takes_off_once_armed():
    bench = Bench(kind=1)
    bench.tell(mavlink.MAVLink_heartbeat_message(1, 3, 0x51, 0, 4, 3))
    bench.step()
    heard = len(bench.autopilot.heard)
    launches = [("takeoff", (50.0,)), ("mission", ())]
    assert ends_of(bench, launches) == [f"{verb} interrupted: the UA is not armed" for verb, _ in launches]
    bench.step()
    assert len(bench.autopilot.heard) == heard
    arms(bench, "us")
    assert ends_of(bench, launches[:1]) == [], "a heartbeat may not show it yet"


def test_a_target_that_fails_at_once_leaves_what_is_flown():
    bench = guided()
    bench.tell(heartbeat(armed=False))
    assert ends_of(bench, [("land", ()), *FLOWN[:1]]) == ["velocity interrupted: the UA is not armed"]


def arms(bench, by):
    """Have the UA armed, which no heartbeat shows yet."""
    if by == "us":
        bench.commands.start("arm")
    else:
        client = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
        message = mavlink.MAVLink_command_long_message(7, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)
        (frame,) = Framer().receive(bytes(message.pack(client)))
        assert bench.vehicle.client_frame(frame, 1) is not None


@pytest.mark.parametrize("by", ["us", "a client"])
def test_a_target_after_arming_waits_for_a_heartbeat_to_show_it(by):
    bench = guided()
    bench.tell(heartbeat(armed=False))
    bench.step()
    arms(bench, by)
    ends = ends_of(bench, FLOWN[:1])
    for _ in range(21):
        bench.step()
    bench.tell(heartbeat(armed=True))
    assert ends == []
    arms(bench, by)
    bench.step()
    bench.tell(heartbeat(armed=False))
    assert ends == ["velocity interrupted: the UA is not armed"]
    assert ends_of(bench, FLOWN[:1]) == [], "that heartbeat may be older than the arming"
    for _ in range(20):
        bench.step()
    bench.tell(heartbeat(armed=False))
    assert ends_of(bench, FLOWN[:1]) == ["velocity interrupted: the UA is not armed"]


def test_a_silent_autopilot_is_not_known_to_be_disarmed():
    bench = guided()
    bench.tell(heartbeat(armed=False))
    bench.now_ns += 5 * S
    assert ends_of(bench, FLOWN[:1]) == []


def test_a_velocity_that_nothing_has_shown_to_be_flown_is_not_reached():
    on_ground = replace(COPTER, armed=False)
    flight = Flight(targets.velocity(on_ground, 1.0, 0.0, duration_s=3.0), on_ground)
    flight.after(0.0)
    flight.after(2.99)
    assert flight.execution.result is None
    flight.after(0.01)
    assert str(flight.execution.result) == "velocity interrupted: the UA is not armed"


def test_what_this_vehicle_cannot_do_is_refused_not_raised():
    bench = Bench(kind=1)
    ends = []
    bench.commands.start("velocity", 1.0, 0.0, on_done=ends.append)
    assert ends[0].outcome is Outcome.REFUSED
    generic = Bench(mav_autopilot=0)
    generic.commands.start("takeoff", 20.0, on_done=ends.append)
    assert ends[1].reason == "takeoff is known of ArduPilot and PX4 alone, and MAV_AUTOPILOT is 0"


def test_a_reboot_is_the_goal_of_one_and_the_end_of_others():
    bench = guided()
    ends = []
    bench.tell(mavlink.MAVLink_system_time_message(0, 100_000))
    for verb, arguments in (("goto", (47.0, 8.0, 20.0)), ("reboot", ())):
        bench.commands.start(verb, *arguments, on_done=lambda result: ends.append(str(result)))
    assert ends == ["goto interrupted: by reboot"]
    bench.commands.start("parameter_get", "X", on_done=lambda result: ends.append(str(result)))
    bench.tell(mavlink.MAVLink_system_time_message(0, 100))
    assert ends[1:] == ["reboot reached", "parameter_get interrupted: the autopilot rebooted"]


def test_px4_modes_are_set_by_main_and_sub_mode():
    px4 = replace(COPTER, autopilot=12)
    message = plans.set_mode(px4, "auto.mission").steps[0].message(0)
    assert (message.command, message.param1, message.param2, message.param3) == (176, 1.0, 4.0, 4.0)
    message = plans.rtl(px4).steps[0].message(0)
    assert (message.param2, message.param3) == (4.0, 5.0)


def test_hold_stops_a_copter_in_guided_and_is_done_when_it_stands_still():
    flight = Flight(targets.hold(replace(COPTER, mode="LOITER")), replace(COPTER, mode="LOITER"))
    (enter,) = flight.after(0.0)
    assert (enter.command, enter.param2) == (mavlink.MAV_CMD_DO_SET_MODE, 4)
    flight.execution.on_ack(mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_RESULT_ACCEPTED)
    fast = flight.after(0.1, mode="GUIDED", velocity_ned_mps=(5.0, 0.0, 0.0))
    assert [(message.vx, message.vy, message.vz) for message in fast] == [(0.0, 0.0, 0.0)]
    assert flight.execution.result is None
    assert len(flight.after(0.1, velocity_ned_mps=(0.1, 0.0, 0.1))) == 1, (
        "a last stop, if the first was too early"
    )
    assert flight.execution.result.reached


def test_hold_has_a_plane_circle():
    flight = Flight(targets.hold(PLANE), PLANE)
    (enter,) = flight.after(0.0)
    assert (enter.command, enter.param2) == (mavlink.MAV_CMD_DO_SET_MODE, 12)
    flight.execution.on_ack(mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_RESULT_ACCEPTED)
    assert flight.after(0.1, mode="LOITER") == []
    assert flight.execution.result.reached


@pytest.mark.parametrize(("said", "is_flown"), [("Landing sequence start", True), ("", False)])
def test_a_plane_s_return_goes_on_to_the_landing_of_its_mission(said, is_flown):
    # RTL_AUTOLAND: ArduPlane is at home for it before it is within 200 m.
    plane = replace(PLANE, home_lat_deg=47.01, home_lon_deg=8.0, landed_state="in_air", heard_ns={0: 1})
    flight = Flight(plans.rtl(plane), plane)
    flight.after(0.0)
    flight.execution.on_ack(mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_RESULT_ACCEPTED)
    flight.after(0.1)
    flight.after(1.0, mode="RTL", heard_ns={0: S})
    flight.after(0.1, mode="AUTO", lat_deg=47.0079, waypoint_distance_m=150.0, heard_ns={0: 2 * S, 62: 2 * S})
    assert flight.execution.result is None
    if said:
        flight.execution.on_text(StatusText(6, said))
    flight.after(2.0)
    assert (flight.execution.result is None) == is_flown
    if is_flown:
        flight.after(60.0, landed_state="on_ground")
    assert flight.execution.result.reached == is_flown


def test_a_plane_s_point_after_a_circle_is_circled_as_it_is_set():
    # ArduPlane keeps the radius of a circle in GUIDED, however often that is asked for (ModeGuided::_enter).
    bench = Bench(kind=1)
    bench.tell(mavlink.MAVLink_heartbeat_message(1, 3, 0xD1, 15, 4, 3))
    for verb, arguments, first in (
        ("goto", (47.0, 8.0, 90.0), 15.0),
        ("orbit", (47.0, 8.0, 90.0, 400.0), 15.0),
        ("goto", (47.1, 8.0, 90.0), 12.0),
        ("goto", (47.2, 8.0, 90.0), 15.0),
    ):
        before = len(bench.heard("COMMAND_LONG"))
        bench.commands.start(verb, *arguments)
        bench.step()
        mode = bench.heard("COMMAND_LONG")[before]
        assert (mode.command, mode.param2) == (mavlink.MAV_CMD_DO_SET_MODE, first)


def test_a_refusal_without_words_says_what_it_may_be():
    flight = Flight(targets.goto(COPTER, 47.1, 8.0, 20.0))
    flight.after(0.0)
    flight.execution.on_ack(mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_RESULT_ACCEPTED)
    flight.after(0.1)
    flight.execution.on_ack(mavlink.MAV_CMD_DO_REPOSITION, mavlink.MAV_RESULT_FAILED)
    flight.after(0.1)
    flight.after(1.0)
    assert flight.execution.result.reason.startswith("FAILED (no position yet, a point beyond its fence")
