from dataclasses import replace

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from aps.timeouts import ACK_TIMEOUTS_S, LINK_LOSS_TIMEOUT_S
from aps.vehicle.commands.command_execution import CommandExecution
from aps.vehicle.execution import Outcome, Refusal
from aps.vehicle.flight import plans, targets
from aps.vehicle.status_text import StatusText
from aps.vehicle.telemetry import VehicleState

S = 1_000_000_000
ARM, MODE, TAKEOFF, REPOSITION, SPEED = 400, 176, 22, 192, 178
ACCEPTED, DENIED, FAILED, IN_PROGRESS = 0, 2, 4, 5
ON_GROUND = VehicleState(
    sysid=3,
    vehicle_type=mavlink.MAV_TYPE_QUADROTOR,
    autopilot=3,
    time_boot_ms=60_000,
    mode="GUIDED",
    lat_deg=47.0,
    lon_deg=8.0,
    alt_rel_m=0.0,
    landed_state="on_ground",
    home_lat_deg=47.0,
    home_lon_deg=8.0,
)
ARMED = replace(ON_GROUND, armed=True)
FLYING = replace(ARMED, landed_state="in_air", alt_rel_m=20.0)


def accepted(execution, state, now_ns=0):
    """Acknowledge every step; returns the messages that were sent."""
    sent = []
    while messages := execution.poll(state, now_ns):
        sent += messages
        execution.on_ack(messages[0].command, ACCEPTED)
    return sent


def phases(execution):
    return [event.phase for event in execution.events]


def test_arm_is_reached_when_the_heartbeat_says_so():
    execution = CommandExecution(plans.arm(ON_GROUND))
    (message,) = execution.poll(ON_GROUND, 0)
    assert (message.command, message.param1, message.target_system, message.target_component) == (
        ARM,
        1,
        3,
        1,
    )
    assert execution.poll(ON_GROUND, 1) == []
    execution.on_ack(ARM, ACCEPTED)
    execution.poll(ON_GROUND, 2)
    assert execution.result is None
    assert phases(execution) == ["accepted"]
    execution.poll(ARMED, 3)
    assert execution.result.reached
    assert str(execution.result) == "arm reached"
    assert execution.deadline_ns() is None


def test_refusal_comes_with_the_autopilots_words():
    execution = CommandExecution(plans.arm(ON_GROUND))
    execution.poll(ON_GROUND, 0)
    execution.on_text(StatusText(6, "chatter"))
    execution.on_text(StatusText(2, "Arm: Gyros inconsistent"))
    execution.on_text(StatusText(2, "Arm: Gyros inconsistent"))
    execution.on_text(StatusText(2, "Arm: Throttle too high"))
    execution.on_ack(ARM, FAILED)
    execution.poll(ON_GROUND, 1)
    assert execution.result.outcome is Outcome.REFUSED
    assert execution.result.reason == "FAILED: Arm: Gyros inconsistent; Arm: Throttle too high"


def test_words_that_come_after_the_refusal_are_waited_for():
    execution = CommandExecution(plans.arm(ON_GROUND))
    execution.poll(ON_GROUND, 0)
    execution.on_ack(ARM, FAILED)
    execution.poll(ON_GROUND, S)
    assert execution.result is None
    assert execution.deadline_ns() == S + 300_000_000
    execution.on_text(StatusText(2, "Arm: Need Position Estimate"))
    execution.poll(ON_GROUND, S + 1)
    assert execution.result.reason == "FAILED: Arm: Need Position Estimate"


def test_wordless_refusal_ends_with_the_hint():
    execution = CommandExecution(plans.takeoff(ON_GROUND, 10.0))
    execution.poll(ON_GROUND, 0)
    execution.on_ack(MODE, ACCEPTED)
    execution.poll(ON_GROUND, 0)
    execution.on_ack(TAKEOFF, DENIED)
    execution.poll(ON_GROUND, 0)
    execution.poll(ON_GROUND, execution.deadline_ns())
    assert execution.result.reason == "DENIED (the UA is not armed)"


def test_retries_with_rising_confirmation_then_times_out():
    execution = CommandExecution(plans.arm(ON_GROUND))
    now_ns, confirmations = 0, []
    for timeout_s in ACK_TIMEOUTS_S:
        (message,) = execution.poll(ON_GROUND, now_ns)
        confirmations.append(message.confirmation)
        assert execution.deadline_ns() == now_ns + timeout_s * S
        assert execution.poll(ON_GROUND, execution.deadline_ns() - 1) == []
        now_ns = execution.deadline_ns()
    assert confirmations == list(range(len(ACK_TIMEOUTS_S)))
    assert execution.poll(ON_GROUND, now_ns) == []
    assert execution.result.outcome is Outcome.TIMED_OUT
    assert execution.result.reason == "no acknowledgement after 5 tries"


def test_in_progress_waits_on_without_retries():
    execution = CommandExecution(plans.arm(ON_GROUND))
    execution.poll(ON_GROUND, 0)
    execution.on_ack(ARM, IN_PROGRESS, 40)
    assert execution.poll(ON_GROUND, S // 2) == []
    assert execution.events[-1].text == "in progress, 40 %"
    assert execution.poll(ON_GROUND, 50 * S) == []
    assert execution.result is None
    execution.on_ack(ARM, ACCEPTED)
    execution.poll(ARMED, 51 * S)
    assert execution.result.reached


def test_in_progress_that_never_ends_times_out():
    execution = CommandExecution(plans.arm(ON_GROUND))
    execution.poll(ON_GROUND, 0)
    execution.on_ack(ARM, IN_PROGRESS)
    execution.poll(ON_GROUND, 1)
    assert execution.poll(ON_GROUND, execution.deadline_ns()) == []
    assert execution.result.outcome is Outcome.TIMED_OUT


def test_answer_to_another_command_is_ignored():
    execution = CommandExecution(plans.arm(ON_GROUND))
    execution.poll(ON_GROUND, 0)
    execution.on_ack(TAKEOFF, FAILED)
    execution.poll(ON_GROUND, 1)
    assert execution.result is None


def test_takeoff_sets_guided_climbs_and_is_reached_near_the_height():
    execution = CommandExecution(plans.takeoff(ARMED, 20.0))
    mode, climb = accepted(execution, ARMED)
    assert (mode.command, mode.param2) == (MODE, 4)
    assert (climb.command, climb.param7) == (TAKEOFF, 20.0)
    low = replace(FLYING, alt_rel_m=5.0, time_boot_ms=61_000)
    execution.poll(low, 1)
    feedback = execution.events[-1]
    assert (feedback.phase, feedback.remaining_m) == ("feedback", 15.0)
    execution.poll(replace(FLYING, alt_rel_m=18.9), 2)
    assert execution.result is None
    execution.poll(replace(FLYING, alt_rel_m=19.1), 3)
    assert execution.result.reached


def test_feedback_keeps_the_autopilots_time_not_ours():
    execution = CommandExecution(plans.takeoff(ARMED, 200.0))
    accepted(execution, ARMED)
    execution.events.clear()
    for ms in range(60_000, 70_001, 50):
        execution.poll(replace(FLYING, time_boot_ms=ms), 0)
    assert len(execution.events) == 20


def test_goto_sends_an_exact_position_and_then_the_speed():
    plan = targets.goto(FLYING, 47.0012345, 8.0054321, 40.0, speed_mps=7.0)
    execution = CommandExecution(plan)
    mode, reposition, speed = accepted(execution, FLYING)
    assert mode.command == MODE
    assert (reposition.get_type(), reposition.frame) == ("COMMAND_INT", mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT)
    assert (reposition.x, reposition.y, reposition.z) == (470012345, 80054321, 40.0)
    assert (speed.command, speed.param2) == (SPEED, 7.0)
    near = replace(FLYING, lat_deg=47.0012345 + 3e-5, lon_deg=8.0054321, alt_rel_m=40.0)
    execution.poll(near, 1)  # 3.3 m away
    assert execution.result is None
    execution.poll(replace(near, lat_deg=47.0012345 + 1e-5, alt_rel_m=41.5), 2)  # too high
    assert execution.result is None
    execution.poll(replace(near, lat_deg=47.0012345 + 1e-5), 3)
    assert execution.result.reached


@pytest.mark.parametrize(
    ("vehicle_type", "make"),
    [
        (mavlink.MAV_TYPE_ANTENNA_TRACKER, lambda state: targets.velocity(state, 1.0, 0.0)),
        (mavlink.MAV_TYPE_GROUND_ROVER, plans.land),
        (mavlink.MAV_TYPE_SUBMARINE, plans.rtl),
    ],
)
def test_a_verb_that_takes_a_mode_which_the_vehicle_lacks_is_refused(vehicle_type, make):
    state = replace(FLYING, vehicle_type=vehicle_type, mode="MANUAL")
    with pytest.raises(Refusal, match=f"has no mode [A-Z]+ for vehicles of MAV_TYPE {vehicle_type}"):
        make(state)


def test_a_speed_that_arduplane_refuses_without_a_word_is_told_with_the_likely_cause():
    plane = replace(FLYING, vehicle_type=mavlink.MAV_TYPE_FIXED_WING)
    execution = CommandExecution(targets.goto(plane, 47.1, 8.0, 20.0, speed_mps=7.0))
    for command in (MODE, REPOSITION):
        execution.poll(plane, 0)
        execution.on_ack(command, ACCEPTED)
    execution.poll(plane, 0)
    execution.on_ack(SPEED, FAILED)
    execution.poll(plane, 0)
    execution.poll(plane, 10_000_000_000)
    why = "a speed beyond AIRSPEED_MIN to AIRSPEED_MAX"
    assert f"DO_CHANGE_SPEED refused: FAILED ({why})" in [event.text for event in execution.events]


def test_refused_speed_does_not_end_the_goto():
    execution = CommandExecution(targets.goto(FLYING, 47.001, 8.0, 20.0, speed_mps=7.0))
    for command in (MODE, REPOSITION):
        execution.poll(FLYING, 0)
        execution.on_ack(command, ACCEPTED)
    execution.poll(FLYING, 0)
    execution.on_text(StatusText(4, "too fast"))
    execution.on_ack(SPEED, FAILED)
    execution.poll(FLYING, 0)
    assert execution.result is None
    refused = [event.text for event in execution.events if event.refused]
    assert refused == ["DO_CHANGE_SPEED refused: FAILED: too fast"]
    execution.poll(replace(FLYING, lat_deg=47.001), 1)
    assert execution.result.reached


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"mode": "RTL"}, "mode changed to RTL (Battery failsafe)"),
        ({"armed": False}, "the UA is not armed (Battery failsafe)"),
    ],
)
def test_leaving_mode_or_disarming_interrupts(change, reason):
    execution = CommandExecution(targets.goto(FLYING, 47.01, 8.0, 20.0))
    accepted(execution, FLYING)
    execution.poll(FLYING, 1)
    execution.on_text(StatusText(4, "Battery failsafe"))
    execution.poll(replace(FLYING, **change), 2)
    assert (execution.result.outcome, execution.result.reason) == (Outcome.INTERRUPTED, reason)


@pytest.mark.parametrize(
    "text", ["Polygon fence breached", "Max Alt and Circle fences breached", "Fence Breached"]
)
def test_a_breach_of_the_fence_is_a_reason_though_it_is_no_warning(text):
    execution = CommandExecution(targets.goto(FLYING, 47.01, 8.0, 20.0))
    accepted(execution, FLYING)
    execution.poll(FLYING, 1)
    for said in (text, "Fence breach cleared", "Manual recovery started"):
        execution.on_text(StatusText(5, said))
    execution.poll(replace(FLYING, mode="RTL"), 2)
    assert execution.result.reason == f"mode changed to RTL ({text})"


def test_a_mode_not_yet_shown_by_the_heartbeat_is_no_interruption():
    before = replace(FLYING, mode="LOITER")
    execution = CommandExecution(targets.goto(before, 47.01, 8.0, 20.0))
    accepted(execution, before)
    execution.poll(replace(before, time_boot_ms=60_900), 1)
    assert execution.result is None


@pytest.mark.parametrize(
    "said", ["Mission complete, changing mode to RTL", "Battery failsafe"], ids=["ArduPlane", "a warning"]
)
def test_a_mode_that_is_left_before_a_heartbeat_shows_it_ends_with_the_autopilots_words(said):
    """ArduPlane's AUTO without a mission is RTL by the next heartbeat; a heartbeat from before may be on its way."""
    execution = CommandExecution(plans.set_mode(FLYING, "AUTO"))
    accepted(execution, FLYING)
    execution.on_text(StatusText(6 if "mode" in said else 4, said))
    execution.poll(replace(FLYING, mode="LOITER", heard_ns={0: S // 10}), S // 2)
    assert execution.result is None
    execution.poll(replace(FLYING, mode="RTL", heard_ns={0: S}), S)
    assert execution.result.reason == f"mode changed to RTL ({said})"


def test_a_mode_that_does_not_come_is_told_with_that_which_stays():
    execution = CommandExecution(plans.set_mode(FLYING, "AUTO"))
    accepted(execution, FLYING)
    late = replace(FLYING, time_boot_ms=70_100)
    execution.poll(late, S)
    assert execution.result.reason == "not there after 10 s of autopilot time"
    execution = CommandExecution(plans.set_mode(FLYING, "AUTO"))
    accepted(execution, FLYING)
    execution.poll(replace(late, heard_ns={0: S}), S)
    assert execution.result.reason == "accepted, but not begun within 10 s of autopilot time: GUIDED"


@pytest.mark.parametrize(
    ("vehicle", "mode", "kind", "hint"),
    [
        (
            mavlink.MAV_TYPE_FIXED_WING,
            "TAKEOFF",
            None,
            "ArduPlane takes speeds in AUTO, GUIDED, and flies TAKEOFF",
        ),
        (
            mavlink.MAV_TYPE_FIXED_WING,
            "RTL",
            "ground",
            "ArduPlane takes speeds in AUTO, GUIDED, and flies RTL",
        ),
        (mavlink.MAV_TYPE_FIXED_WING, "GUIDED", "air", "a speed beyond AIRSPEED_MIN to AIRSPEED_MAX"),
        (mavlink.MAV_TYPE_FIXED_WING, "GUIDED", "climb", "ArduPlane changes no climb speed on the way"),
        (
            mavlink.MAV_TYPE_QUADROTOR,
            "LAND",
            None,
            "ArduCopter takes speeds in AUTO, GUIDED, RTL, and flies LAND",
        ),
        (mavlink.MAV_TYPE_QUADROTOR, "RTL", None, "DO_CHANGE_SPEED; the autopilot does not say why"),
    ],
)
def test_a_speed_that_is_refused_without_words_has_the_likely_cause(vehicle, mode, kind, hint):
    state = replace(FLYING, vehicle_type=vehicle, mode=mode)
    execution = CommandExecution(plans.change_speed(state, 22.0, kind))
    execution.poll(state, 0)
    execution.on_ack(SPEED, FAILED)
    execution.poll(state, 0)
    execution.poll(state, S)
    assert execution.result.reason == f"FAILED ({hint})"


def test_goto_of_a_ua_that_is_not_armed_ends():
    execution = CommandExecution(targets.goto(ON_GROUND, 47.01, 8.0, 20.0))
    accepted(execution, ON_GROUND)
    execution.poll(replace(ON_GROUND, time_boot_ms=62_000), 1)
    assert execution.result is None
    execution.poll(replace(ON_GROUND, time_boot_ms=63_100), 2)
    assert execution.result.reason == "the UA is not armed"


def test_goal_that_is_not_reached_times_out_in_autopilot_time():
    plan = plans.takeoff(ARMED, 20.0)
    execution = CommandExecution(plan)
    accepted(execution, ARMED)
    last_ms = 60_000 + round(plan.timeout_s * 1000)
    execution.poll(replace(ARMED, time_boot_ms=last_ms), 10_000 * S)
    assert execution.result is None
    execution.poll(replace(ARMED, time_boot_ms=last_ms + 1), 1)
    assert execution.result.outcome is Outcome.TIMED_OUT


@pytest.mark.parametrize("plan", [plans.rtl(FLYING), plans.land(FLYING)])
def test_return_and_landing_are_reached_on_the_ground(plan):
    execution = CommandExecution(plan)
    accepted(execution, FLYING)
    down = replace(FLYING, mode=plan.modes[0], alt_rel_m=0.2)
    execution.poll(down, 1)
    assert execution.result is None
    execution.poll(replace(down, landed_state="on_ground"), 2)
    assert execution.result.reached


def test_lost_link_is_forgiven_for_a_while():
    execution = CommandExecution(targets.goto(FLYING, 47.01, 8.0, 20.0))
    accepted(execution, FLYING)
    execution.on_link(False, 5 * S)
    assert execution.deadline_ns() == (5 + LINK_LOSS_TIMEOUT_S) * S
    execution.poll(FLYING, 34 * S)
    execution.on_link(True, 34 * S)
    execution.poll(FLYING, 60 * S)
    assert execution.result is None
    execution.on_link(False, 61 * S)
    execution.poll(FLYING, 91 * S)
    assert execution.result.reason == "no link to the autopilot for 30 s"


def test_interrupted_by_another_command_keeps_the_first_result():
    execution = CommandExecution(plans.arm(ON_GROUND))
    execution.interrupt("by rtl")
    execution.interrupt("again")
    assert str(execution.result) == "arm interrupted: by rtl"
    assert execution.poll(ON_GROUND, 0) == []
