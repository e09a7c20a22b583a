"""The stand-in's MAVLink side, without sockets: what ArduCopter answers, on a vehicle that stands."""

import json
import math
import sys
from collections.abc import Callable
from itertools import pairwise, product
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from standin import cli
from standin.autopilot import Autopilot
from standin.vehicle.auto import Auto
from standin.vehicle.events import Severity
from standin.vehicle.location import Location
from standin.vehicle.parameters import (
    StandinParameters,
    UnknownParameterError,
)
from standin.wire.fdm_link import FdmLink
from standin.wire.mavlink_codec import MavlinkCodec
from standin.wire.sensors import parse_sensor_frame

HOME = Location(45.0, 10.0, 100.0)
STEP_S = 0.0025
GUIDED, AUTO, RTL = 4, 3, 6


def sensor_frame(timestamp_s: float, **changes: Any) -> bytes:
    frame: dict[str, Any] = {
        "timestamp": timestamp_s,
        "imu": {"gyro": [0.0, 0.0, 0.0], "accel_body": [0.0, 0.0, -9.80665]},
        "position": [0.0, 0.0, 0.0],
        "velocity": [0.0, 0.0, 0.0],
        "quaternion": [1.0, 0.0, 0.0, 0.0],
        "airspeed": 0.0,
        "no_time_sync": 1,
    }
    return b"\n" + json.dumps(frame | changes, separators=(",", ":")).encode() + b"\n"


def calls_of(work: Callable[[], object]) -> int:
    """How many functions are called by it."""
    count = 0

    def seen(_: object, event: str, __: object) -> None:
        nonlocal count
        count += event.endswith("call")

    sys.setprofile(seen)
    try:
        work()
    finally:
        sys.setprofile(None)
    return count


class Bench:
    """An autopilot on the ground with a client."""

    def __init__(self) -> None:
        parameters = StandinParameters()
        parameters.set("MAV_SYSID", 7)
        self.autopilot = Autopilot(HOME, parameters, frame_rate_hz=400, boot_unix_us=0)
        self.autopilot.mavlink.connect()
        self.client = dialect.MAVLink(None, 255, 190)
        self.parser = dialect.MAVLink(None)
        self.frames = 0
        self.pose: dict[str, Any] = {}
        """What the sensor frames have that a vehicle at rest at its home has not."""
        self.heard: list[Any] = []

    def run(self, duration_s: float) -> list[Any]:
        heard = []
        for _ in range(round(duration_s / STEP_S)):
            heard += self.turn()
        return heard

    def turn(self, **changes: Any) -> list[Any]:
        """One frame of physics; return what the autopilot says in it."""
        assert self.autopilot.take_frame(
            parse_sensor_frame(sensor_frame(self.frames * STEP_S, **(self.pose | changes)))
        )
        self.frames += 1
        self.autopilot.step()
        return self.take()

    def take(self) -> list[Any]:
        data = self.autopilot.mavlink.data_to_send()
        heard = (self.parser.parse_buffer(data) or []) if data else []
        self.heard += heard
        return heard

    def say(self, message: Any) -> list[Any]:
        """Return the answer; heartbeats are none."""
        self.autopilot.mavlink.receive(message.pack(self.client))
        assert self.take() == [], "what was said takes effect with the next frame"
        return [m for m in self.turn() if m.get_type() != "HEARTBEAT"]

    def command(self, number: int, *parameters: float) -> list[Any]:
        padded = [*parameters, *([0.0] * (7 - len(parameters)))]
        return self.say(dialect.MAVLink_command_long_message(7, 1, number, 0, *padded))


@pytest.fixture
def bench() -> Bench:
    return Bench()


@pytest.fixture
def ready(bench: Bench) -> Bench:
    bench.run(4.0)
    bench.command(176, 1, GUIDED)
    return bench


def results(messages: list[Any]) -> list[tuple[int, int]]:
    return [(m.command, m.result) for m in messages if m.get_type() == "COMMAND_ACK"]


def texts(messages: list[Any]) -> list[str]:
    return [m.text for m in messages if m.get_type() == "STATUSTEXT"]


def kinds(messages: list[Any]) -> list[str]:
    return [m.get_type() for m in messages]


# --- output without being asked ---


def test_only_heartbeats_and_news_go_out_by_default(bench: Bench) -> None:
    heard = bench.run(10.0)
    beats = [m for m in heard if m.get_type() == "HEARTBEAT"]
    assert len(beats) == 10
    assert set(kinds(heard)) == {"HEARTBEAT", "STATUSTEXT", "HOME_POSITION"}
    assert (beats[0].type, beats[0].autopilot, beats[0].base_mode, beats[0].custom_mode) == (2, 3, 81, 0)
    assert (beats[0].get_srcSystem(), beats[0].get_srcComponent()) == (7, 1)


def test_heartbeat_tells_the_mode_at_once(ready: Bench) -> None:
    ready.run(0.1)
    ready.heard.clear()
    ready.command(176, 1, RTL)
    beats = [m for m in ready.heard if m.get_type() == "HEARTBEAT"]
    assert [(m.base_mode, m.custom_mode) for m in beats] == [(89, RTL)]


# --- arming ---


@pytest.mark.parametrize(
    ("wait_s", "text"), [(0.5, "Arm: GPS 1: Bad fix"), (2.0, "Arm: Need Position Estimate")]
)
def test_arming_too_early_is_refused_with_the_reason(bench: Bench, wait_s: float, text: str) -> None:
    bench.command(176, 1, GUIDED)
    bench.run(wait_s)
    answer = bench.command(400, 1)
    assert results(answer) == [(400, 4)]
    assert texts(answer) == [text]


def test_prearm_bit_and_arming_follow_within_five_seconds(bench: Bench) -> None:
    bench.command(176, 1, GUIDED)
    bench.run(1.5)
    before = next(m for m in bench.command(512, 1) if m.get_type() == "SYS_STATUS")
    assert not before.onboard_control_sensors_health & dialect.MAV_SYS_STATUS_PREARM_CHECK
    bench.run(3.5)
    after = next(m for m in bench.command(512, 1) if m.get_type() == "SYS_STATUS")
    assert after.onboard_control_sensors_health & dialect.MAV_SYS_STATUS_PREARM_CHECK
    answer = bench.command(400, 1)
    assert results(answer) == [(400, 0)]
    assert texts(answer) == ["Arming motors"]
    assert any(m.get_type() == "HEARTBEAT" and m.base_mode & 128 for m in bench.heard)


def test_modes_that_cannot_arm_say_so(ready: Bench) -> None:
    assert results(ready.command(176, 1, RTL)) == [(176, 0)]
    answer = ready.command(400, 1)
    assert results(answer) == [(400, 4)]
    assert texts(answer) == ["Arm: RTL mode not armable"]
    ready.command(176, 1, AUTO)
    assert texts(ready.command(400, 1)) == ["Arm: Mode requires mission"]


def test_forced_arming_skips_the_checks(bench: Bench) -> None:
    bench.run(0.1)
    assert results(bench.command(400, 1, 21196)) == [(400, 0)]


def test_a_leaning_vehicle_does_not_arm(bench: Bench) -> None:
    bench.run(4.0)
    request = dialect.MAVLink_command_long_message(7, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)
    bench.autopilot.mavlink.receive(request.pack(bench.client))
    assert texts(bench.turn(quaternion=[math.cos(0.5), math.sin(0.5), 0.0, 0.0])) == ["Arm: Leaning"]


def test_an_armed_vehicle_that_stands_is_disarmed_after_the_delay(ready: Bench) -> None:
    ready.command(400, 1)
    ready.run(9.5)
    assert ready.autopilot.vehicle.armed
    heard = ready.run(1.0)
    assert "Disarming motors" in texts(heard)
    assert not ready.autopilot.vehicle.armed


def test_a_throttle_stick_that_is_held_up_keeps_the_vehicle_armed(ready: Bench) -> None:
    """As ArduCopter's auto_disarm_check: the delay begins when the stick is at zero."""

    def hold(throttle: int, duration_s: int) -> None:
        for _ in range(duration_s):
            ready.say(dialect.MAVLink_manual_control_message(7, 0, 0, throttle, 0, 0))
            ready.run(1.0)

    vehicle = ready.autopilot.vehicle
    ready.command(400, 1)
    hold(500, 15)
    assert vehicle.armed
    hold(40, 15)
    assert vehicle.armed
    hold(20, 9)
    assert vehicle.armed
    ready.run(1.5)
    assert not vehicle.armed
    ready.command(400, 1)
    hold(500, 8)
    ready.run(11.5)  # the word of a client that falls silent holds for 3 s
    assert vehicle.armed
    ready.run(1.0)
    assert not vehicle.armed


def test_motors_idle_while_armed_and_stop_when_disarmed(ready: Bench) -> None:
    vehicle = ready.autopilot.vehicle
    ready.command(400, 1)
    ready.run(0.1)
    assert vehicle.servo_output_us[:5] == [1100, 1100, 1100, 1100, 0]
    ready.command(400, 0)
    ready.run(0.1)
    assert vehicle.servo_output_us[:5] == [1000, 1000, 1000, 1000, 0]


# --- commands ---


def test_unknown_commands_modes_and_targets(ready: Bench) -> None:
    assert results(ready.command(12345)) == [(12345, 3)]
    answer = ready.command(176, 1, 99)
    assert results(answer) == [(176, 4)]
    assert texts(answer) == ["No such mode 99"]
    assert results(ready.command(176, 0, GUIDED)) == [(176, 2)]
    assert ready.say(dialect.MAVLink_command_long_message(8, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)) == []
    assert not ready.autopilot.vehicle.armed
    assert ready.autopilot.mavlink.ignored["other_target"] == 1
    answer = ready.say(dialect.MAVLink_command_long_message(7, 154, 400, 0, 1, 0, 0, 0, 0, 0, 0))
    assert results(answer) == [(400, 0)], "a component that is not there: MAVLink_routing::check_and_forward"


def test_set_mode_message_changes_the_mode_without_acknowledgement(ready: Bench) -> None:
    assert ready.say(dialect.MAVLink_set_mode_message(7, 1, RTL)) == []
    assert ready.autopilot.vehicle.mode.name == "RTL"


def test_takeoff_needs_an_armed_vehicle_in_guided(ready: Bench) -> None:
    assert results(ready.command(22, 0, 0, 0, 0, 0, 0, 20)) == [(22, 4)]
    ready.command(400, 1)
    assert results(ready.command(22, 0, 0, 0, 0, 0, 0, 0)) == [(22, 4)]
    assert results(ready.command(22, 0, 0, 0, 0, 0, 0, math.nan)) == [(22, 2)]
    assert results(ready.command(22, 0, 0, 0, 0, 0, 0, 20)) == [(22, 0)]
    assert results(ready.command(22, 0, 0, 0, 0, 0, 0, 20)) == [(22, 4)]
    ready.run(1.0)
    assert min(ready.autopilot.vehicle.servo_output_us[:4]) > 1150, "the motors speed up"


def test_reposition_is_taken_as_command_int_only(ready: Bench) -> None:
    assert results(ready.command(192, -1, 1, 0, 0, 45.001, 10.001, 20)) == [(192, 3)]
    message = dialect.MAVLink_command_int_message(7, 1, 6, 192, 0, 0, -1, 1, 0, 0, 450010000, 100010000, 20)
    assert results(ready.say(message)) == [(192, 0)]
    bad = dialect.MAVLink_command_int_message(7, 1, 6, 192, 0, 0, -1, 1, 0, 0, 950010000, 100010000, 20)
    assert results(ready.say(bad)) == [(192, 2)]
    before = ready.autopilot.vehicle.mode
    for lat, lon, alt in ((0, 0, 20), (450010000, 100010000, 0)):  # Location::sanitize
        bad = dialect.MAVLink_command_int_message(7, 1, 6, 192, 0, 0, -1, 1, 0, 0, lat, lon, alt)
        assert results(ready.say(bad)) == [(192, 2)]
    assert ready.autopilot.vehicle.mode is before
    level = dialect.MAVLink_command_int_message(7, 1, 5, 192, 0, 0, -1, 1, 0, 0, 450010000, 100010000, 0)
    assert results(ready.say(level)) == [(192, 0)], "the sea's level is a height"


@pytest.mark.parametrize(("interval_us", "result"), [(1, 2), (2999, 2), (3000, 0), (-1, 0), (0, 0)])
def test_rates_beyond_the_loop_are_denied_as_by_arducopter(
    ready: Bench, interval_us: float, result: int
) -> None:
    answer = ready.command(511, 33, interval_us)
    assert results(answer) == [(511, result)]
    words = ["Requested rate for message ID 33 too fast. Increas", "e SCHED_LOOP_RATE"]
    assert texts(answer) == (words if result else [])


@pytest.mark.parametrize("length", [50, 51, 100, 127])
def test_long_texts_are_sent_in_chunks(ready: Bench, length: int) -> None:
    ready.autopilot.vehicle.say(Severity.INFO, "x" * length)
    told = [m for m in ready.turn() if m.get_type() == "STATUSTEXT"]
    assert "".join(m.text for m in told) == "x" * length
    assert [(m.id, m.chunk_seq) for m in told] == [(int(length > 50), number) for number in range(len(told))]
    assert (len(told) == 1) == (length == 50)
    assert length == 50 or len(told[-1].text) < 50, "this is the end"


def test_disarming_is_forced_by_one_number_alone(ready: Bench) -> None:
    in_the_air(ready)
    assert results(ready.command(400, 0, 2989)) == [(400, 4)]
    assert ready.autopilot.vehicle.armed
    assert results(ready.command(400, 0, 21196)) == [(400, 0)]


def test_home_is_told_when_the_vehicle_arms(ready: Bench) -> None:
    ready.turn(position=[10.0, 0.0, 0.0])
    home = next(m for m in ready.command(400, 1) if m.get_type() == "HOME_POSITION")
    assert (home.latitude, home.longitude, home.altitude) == (450_000_000, 100_000_000, 100_000)
    (asked,) = [m for m in ready.command(512, 242) if m.get_type() == "HOME_POSITION"]
    assert asked.latitude == home.latitude


def test_speed_changes(ready: Bench) -> None:
    assert results(ready.command(178, 1, 7)) == [(178, 0)]
    assert ready.autopilot.vehicle.limits().horizontal.speed_mps == 7.0
    assert results(ready.command(178, 1, 0)) == [(178, 2)]
    assert [results(ready.command(178, kind, 3 + kind)) for kind in (2, 3)] == [[(178, 0)]] * 2
    assert speeds(ready) == (7.0, 2.5, 6.0), "in GUIDED the last of climbing and sinking counts"
    assert results(ready.command(178, 0, 50)) == [(178, 0)], "airspeed is taken for ground speed"
    assert speeds(ready) == (50.0, 2.5, 6.0)
    assert results(ready.command(178, 4, 3)) == [(178, 2)]
    assert results(ready.command(178, math.nan, 3)) == [(178, 2)]
    assert results(ready.command(178, 1, math.inf)) == [(178, 2)]
    assert results(ready.command(176, 1, RTL)) == [(176, 0)]
    assert speeds(ready) == (10.0, 2.5, 1.5), "they end with the mode"


def speeds(bench: Bench) -> tuple[float, float, float]:
    """Over ground, climbing, sinking."""
    limits = bench.autopilot.vehicle.limits()
    return (limits.horizontal.speed_mps, limits.climb_mps, limits.sink_mps)


def test_a_missions_speeds_are_of_the_type_that_they_say(ready: Bench) -> None:
    def speed(seq: int, kind: float, speed_mps: float) -> Any:
        message = item(seq, 178, frame=2)
        message.param1, message.param2 = kind, speed_mps
        return message

    changes = [speed(1, 2, 4.0), speed(2, 3, 0.5), speed(3, 7, 9.0), speed(4, 1, 6.0), speed(5, 3, -1.0)]
    upload(ready, [item(0), *changes, item(6, lat=450_010_000)])
    in_the_air(ready)
    ready.command(176, 1, AUTO)
    ready.run(0.1)
    assert ready.autopilot.vehicle.mission.current == 6
    assert speeds(ready) == (6.0, 4.0, 0.5)


def test_position_targets_are_taken_in_guided_flight_only(ready: Bench) -> None:
    vehicle = ready.autopilot.vehicle

    def target(mask: int, frame: int = 1, north_m: float = 30.0) -> tuple[float, float] | None:
        ready.say(
            dialect.MAVLink_set_position_target_local_ned_message(
                0, 7, 1, frame, mask, north_m, 5.0, -9.0, 2.0, 0, 0, 0, 0, 0, 0, 0
            )
        )
        return vehicle.navigator.point_m

    assert target(0x0DF8) is None, "on the ground"
    ready.command(400, 1)
    vehicle.leave_ground()
    assert target(0x0DF8) == (30.0, 5.0)
    assert target(0x0DC7) is None
    assert vehicle.navigator.velocity_mps == (2.0, 0.0)
    assert target(0x0DF8) == (30.0, 5.0)
    assert target(0x0DF8, frame=12) is None, "a frame that is not taken stops the vehicle"
    place = (450_010_000, 100_000_000, 20.0)
    ready.say(
        dialect.MAVLink_set_position_target_global_int_message(
            0, 7, 1, 6, 0x0DF8, *place, 0, 0, 0, 0, 0, 0, 0, 0
        )
    )
    assert vehicle.navigator.point_m == pytest.approx((111.3, 0.0), abs=0.1)
    ready.command(176, 1, RTL)
    assert target(0x0DF8, north_m=99.0) != (99.0, 5.0)


def test_a_point_that_moves_a_velocity_ahead_and_the_nose(ready: Bench) -> None:
    vehicle = ready.autopilot.vehicle
    ready.command(400, 1)
    vehicle.leave_ground()

    def orbits(mask: int, *, yaw_rad: float = 0.0, turn_radps: float = 0.0) -> None:
        place = (450_010_000, 100_000_000, 20.0)
        rest = (0, 5.0, 0, 0, 0, 0, yaw_rad, turn_radps)
        ready.say(dialect.MAVLink_set_position_target_global_int_message(0, 7, 1, 6, mask, *place, *rest))

    orbits(0x09C0, yaw_rad=1.0)
    assert vehicle.navigator.point_mps == (0.0, 5.0)
    ready.run(2.0)
    assert vehicle.navigator.point_m == pytest.approx((111.3, 10.0), abs=0.1), "it goes with its target"
    assert vehicle.navigator.yaw_rad == pytest.approx(1.0, abs=0.2)
    ready.run(2.0)
    assert vehicle.navigator.point_m == pytest.approx((111.3, 15.0), abs=0.2), "GUID_TIMEOUT"

    ready.pose = {"quaternion": [math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)]}  # its nose is in the east
    ready.turn()
    rest = (4.0, 0.0, 0.0, 0, 0, 0, 0, 0.3)
    ready.say(dialect.MAVLink_set_position_target_local_ned_message(0, 7, 1, 8, 0x05C7, 0, 0, 0, *rest))
    assert vehicle.navigator.velocity_mps == pytest.approx((0.0, 4.0), abs=1e-3)
    ready.run(2.5)
    assert vehicle.navigator.yaw_rate_radps == pytest.approx(0.3, abs=0.02)
    ready.run(4.0)
    assert vehicle.navigator.yaw_rate_radps == pytest.approx(0.0, abs=0.02)


def local_target(mask: int, *fields: float) -> Any:
    """SET_POSITION_TARGET_LOCAL_NED: place, velocity, acceleration, yaw, rate of turn."""
    padded = [*fields, *[0.0] * (11 - len(fields))]
    return dialect.MAVLink_set_position_target_local_ned_message(0, 7, 1, 1, mask, *padded)


POINT, MOVING_POINT, VELOCITY, TURNING_POINT, YAW_THAT_TURNS = 0x0DF8, 0x0DC0, 0x0DC7, 0x05F8, 0x01C7


@pytest.mark.parametrize(("yaw_behavior", "yaw_deg"), [(0, 0.0), (1, 90.0), (2, 90.0), (3, 90.0)])
def test_velocities_are_flown_as_asked_and_the_nose_goes_with_them(
    ready: Bench, yaw_behavior: int, yaw_deg: float
) -> None:
    """Real ArduCopter flew 15 m/s eastwards, and 5 m/s upwards, with WPNAV_SPEED 1000 and WPNAV_SPEED_UP 250."""
    vehicle = in_the_air(ready).autopilot.vehicle
    vehicle.parameters.set("WP_YAW_BEHAVIOR", yaw_behavior)
    for _ in range(5):
        ready.say(local_target(VELOCITY, 0, 0, 0, 0.0, 15.0, -5.0))
        ready.run(2.0)
    assert vehicle.navigator.horizontal.east_mps == pytest.approx(15.0, abs=0.05)
    assert vehicle.navigator.vertical.down_mps == pytest.approx(-5.0, abs=0.05)
    assert math.degrees(vehicle.navigator.yaw_rad) == pytest.approx(yaw_deg, abs=0.5)


def test_slow_references_turn_no_nose(ready: Bench) -> None:
    """Real ArduCopter turned for 0.6 m/s, not for 0.3: 5 % of WPNAV_SPEED."""
    vehicle = in_the_air(ready).autopilot.vehicle
    for east_mps, yaw_deg in ((0.45, 0.0), (0.55, 90.0)):
        for _ in range(3):
            ready.say(local_target(VELOCITY, 0, 0, 0, 0.0, east_mps))
            ready.run(2.0)
        assert math.degrees(vehicle.navigator.yaw_rad) == pytest.approx(yaw_deg, abs=0.5), east_mps


def test_in_guided_speeds_are_of_the_kind_of_target(ready: Bench) -> None:
    """As real ArduCopter flew: DO_CHANGE_SPEED, then another kind of target, and it is at WPNAV_SPEED again."""
    vehicle = in_the_air(ready).autopilot.vehicle

    def asked(mask: int, *fields: float) -> tuple[float, float, float]:
        ready.say(local_target(mask, *fields))
        return speeds(ready)

    assert results(ready.command(178, 1, 3.0)) == [(178, 0)]
    assert asked(POINT, 50.0, 0, -20.0) == (10.0, 2.5, 1.5), "of the point"
    assert results(ready.command(178, 1, 3.0)) == [(178, 0)]
    assert asked(POINT, 0.0, 0, -20.0) == (3.0, 2.5, 1.5), "a point as before"
    vehicle.parameters.set("WPNAV_SPEED", 400.0)
    assert asked(POINT, 50.0, 0, -20.0) == (3.0, 2.5, 1.5)
    assert asked(VELOCITY, 0, 0, 0, 8.0) == (4.0, 2.5, 1.5)
    vehicle.parameters.set("WPNAV_SPEED", 500.0)
    assert asked(VELOCITY, 0, 0, 0, 8.0) == (4.0, 2.5, 1.5)
    assert asked(POINT, 0.0, 0, -20.0) == (5.0, 2.5, 1.5)
    assert asked(MOVING_POINT, 0.0, 0, -20.0, 1.0) == (5.0, 2.5, 1.5)
    ready.command(178, 1, 3.0)
    assert speeds(ready)[0] == 3.0
    ready.say(local_target(0x0FFF))
    assert speeds(ready)[0] == 5.0, "it was stopped, and that begins anew"


def test_a_point_moves_up_too_and_turns_end(ready: Bench) -> None:
    """With GUID_TIMEOUT; real ArduCopter climbed 3 m at 1 m/s, and turned 64 degrees at 20 degrees per second."""
    navigator = in_the_air(ready).autopilot.vehicle.navigator
    ready.say(local_target(MOVING_POINT, 0, 0, -20.0, 2.0, 0, -1.0))
    ready.run(6.0)
    assert navigator.target_ned_m() == pytest.approx((6.0, 0.0, -23.0), abs=0.1)
    assert navigator.vertical.down_m == pytest.approx(-23.0, abs=0.1)
    for mask, turned_deg in ((TURNING_POINT, 60.0), (YAW_THAT_TURNS, 90.0 + 60.0)):
        navigator.restart_yaw(ready.autopilot.vehicle.frame)
        ready.say(local_target(mask, 0, 0, -20.0, 0, 0, 0, 0, 0, 0, math.pi / 2.0, math.radians(20.0)))
        ready.run(6.0)
        assert math.degrees(navigator.yaw_rad) == pytest.approx(turned_deg, abs=10.0), mask
        assert navigator.yaw_rate_radps == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize(
    ("frame", "point", "velocity", "yaw_deg"),
    [
        pytest.param(1, (30.0, 5.0, -9.0), (2.0, 1.0, 0.5), 60.0, id="LOCAL_NED"),
        pytest.param(7, (130.0, -45.0, -29.0), (2.0, 1.0, 0.5), 60.0, id="LOCAL_OFFSET_NED"),
        pytest.param(8, (95.0, -20.0, -29.0), (-1.0, 2.0, 0.5), 150.0, id="BODY_NED"),
        pytest.param(9, (95.0, -20.0, -29.0), (-1.0, 2.0, 0.5), 150.0, id="BODY_OFFSET_NED"),
    ],
)
def test_the_frames_of_local_targets(
    ready: Bench,
    frame: int,
    point: tuple[float, float, float],
    velocity: tuple[float, float, float],
    yaw_deg: float,
) -> None:
    """As GCS_MAVLink_Copter.cpp has it; the real one was flown beside it (offsets, velocities and turns)."""
    vehicle = ready.autopilot.vehicle
    ready.command(400, 1)
    ready.pose = {"position": [100.0, -50.0, -20.0], "quaternion": [0.5**0.5, 0.0, 0.0, 0.5**0.5]}
    ready.turn()  # its nose is in the east
    vehicle.leave_ground()
    navigator = vehicle.navigator

    def target(mask: int) -> None:
        rest = (0, 0, 0, math.radians(60.0), 0)
        place, speed = (30.0, 5.0, -9.0), (2.0, 1.0, 0.5)
        message = dialect.MAVLink_set_position_target_local_ned_message
        ready.say(message(0, 7, 1, frame, mask, *place, *speed, *rest))

    target(0x09F8)
    assert navigator.target_ned_m() == pytest.approx(point, abs=1e-3)
    assert math.degrees(navigator.yaw_target_rad) == pytest.approx(yaw_deg, abs=1e-3)
    navigator.restart_yaw(vehicle.frame)
    target(0x09C7)
    assert navigator.point_m is None
    assert (*navigator.velocity_mps, navigator.sink_mps) == pytest.approx(velocity, abs=1e-6)
    assert math.degrees(navigator.yaw_target_rad) == pytest.approx(yaw_deg, abs=1e-3)
    target(0x0DC0)
    assert navigator.point_mps == pytest.approx(velocity[:2], abs=1e-6)
    message = dialect.MAVLink_set_position_target_global_int_message
    ready.say(message(0, 7, 1, frame, 0x0DC7, 0, 0, 0, 2.0, 1.0, 0.5, 0, 0, 0, 0, 0))
    assert navigator.velocity_mps == (2.0, 1.0), "of velocities on the earth no frame is looked at"


def test_loiter_sinks_unless_the_ground_station_holds_the_stick(ready: Bench) -> None:
    vehicle = ready.autopilot.vehicle
    ready.command(400, 1)
    vehicle.leave_ground()
    ready.pose = {"position": [0.0, 0.0, -50.0]}
    ready.command(176, 1, 5)

    def sinks_mps() -> float:
        ready.run(0.1)
        return vehicle.navigator.sink_mps

    assert sinks_mps() == 2.5
    ready.say(dialect.MAVLink_manual_control_message(7, 0, 0, 500, 0, 0))
    assert sinks_mps() == 0.0
    override = [65535, 65535, 2000, *[65535] * 5]
    ready.say(dialect.MAVLink_rc_channels_override_message(7, 1, *override))
    assert sinks_mps() == -2.5
    ready.run(3.0)
    assert sinks_mps() == 2.5, "what is not repeated is forgotten"
    ready.client.srcSystem = 3
    ready.say(dialect.MAVLink_rc_channels_override_message(7, 1, *override))
    assert sinks_mps() == 2.5, "nobody else holds sticks"


def test_a_single_mission_item_is_a_target_in_guided_flight(ready: Bench) -> None:
    """As dronekit's simple_goto sends it."""
    vehicle = ready.autopilot.vehicle

    def answer(current: int, lat_deg: float, command: int = 16) -> list[tuple[str, int]]:
        head = (7, 1, 0, 3, command, current, 0, 0, 0, 0, 0)
        told = ready.say(dialect.MAVLink_mission_item_message(*head, lat_deg, 10.0, 20.0))
        return [(m.get_type(), m.type) for m in told]

    ready.command(400, 1)
    vehicle.leave_ground()
    assert answer(2, 45.001) == [("MISSION_ACK", 0)]
    assert vehicle.navigator.point_m == pytest.approx((111.3, 0.0), abs=0.1)
    assert vehicle.navigator.target_ned_m()[2] == pytest.approx(-20.0, abs=0.1)
    assert answer(2, 95.0) == answer(2, 45.002, command=21) == [("MISSION_ACK", 1)]
    assert answer(3, 45.002) == [("MISSION_ACK", 1)]
    ready.command(176, 1, RTL)
    assert answer(2, 45.002) == [("MISSION_ACK", 1)]
    assert vehicle.navigator.point_m != pytest.approx((222.6, 0.0), abs=0.1)


def test_the_version_is_told_by_the_old_command_too(ready: Bench) -> None:
    answer = ready.command(520, 1)
    assert results(answer) == [(520, 0)]
    assert kinds(answer) == ["COMMAND_ACK", "AUTOPILOT_VERSION"]
    assert results(ready.command(520, 0)) == [(520, 4)]


def test_stabilize_is_for_the_ground(ready: Bench) -> None:
    ready.command(400, 1)
    ready.autopilot.vehicle.leave_ground()
    answer = ready.command(176, 1, 0)
    assert results(answer) == [(176, 4)]
    assert texts(answer) == ["Mode change to STABILIZE failed: no RC"]


# --- streams ---


def test_intervals_set_read_and_stopped(ready: Bench) -> None:
    assert results(ready.command(511, 30, 100_000)) == [(511, 0)]
    attitudes = [m for m in ready.run(2.0) if m.get_type() == "ATTITUDE"]
    assert len(attitudes) == 20
    steps = {b.time_boot_ms - a.time_boot_ms for a, b in pairwise(attitudes)}
    assert steps == {100}
    ready.command(511, 30, -1)
    assert "ATTITUDE" not in kinds(ready.run(1.0))


def test_unknown_messages_cannot_be_streamed(ready: Bench) -> None:
    answer = ready.command(511, 9999, 100_000)
    assert results(answer) == [(511, 2)]
    assert texts(answer) == ["No ap_message for mavlink id (9999)"]
    assert results(ready.command(512, 9999)) == [(512, 4)]


def test_intervals_outlive_the_connection(ready: Bench) -> None:
    ready.command(511, 33, 200_000)
    ready.autopilot.mavlink.disconnect()
    assert ready.run(1.0) == []
    ready.autopilot.mavlink.connect()
    assert kinds(ready.run(1.0)).count("GLOBAL_POSITION_INT") == 5


def test_data_stream_groups(ready: Bench) -> None:
    ready.say(dialect.MAVLink_request_data_stream_message(7, 1, 6, 4, 1))
    heard = kinds(ready.run(1.0))
    assert heard.count("GLOBAL_POSITION_INT") == heard.count("LOCAL_POSITION_NED") == 4
    ready.say(dialect.MAVLink_request_data_stream_message(7, 1, 0, 4, 0))
    assert "GLOBAL_POSITION_INT" not in kinds(ready.run(1.0))


def test_every_message_can_be_requested_and_follows_the_acknowledgement(ready: Bench) -> None:
    for message_id in (
        1,
        2,
        24,
        30,
        32,
        33,
        42,
        62,
        74,
        147,
        148,
        168,
        193,
        242,
        245,
    ):
        answer = ready.command(512, message_id)
        assert results(answer) == [(512, 0)]
        assert [m.get_msgId() for m in answer] == [77, message_id]


def test_state_messages_carry_the_sensor_frame(ready: Bench) -> None:
    flying = {
        "position": [100.0, -50.0, -30.0],
        "velocity": [3.0, 4.0, -1.0],
        "airspeed": 6.0,
        "quaternion": [math.cos(0.25), 0.0, 0.0, math.sin(0.25)],
    }
    for message_id in (33, 74, 30, 32):
        request = dialect.MAVLink_command_long_message(7, 1, 512, 0, message_id, 0, 0, 0, 0, 0, 0)
        ready.autopilot.mavlink.receive(request.pack(ready.client))
    position, hud, attitude, local = [m for m in ready.turn(**flying) if m.get_msgId() in (33, 74, 30, 32)]
    assert (position.alt, position.relative_alt) == (130_000, 30_000)
    assert (position.vx, position.vy, position.vz) == (300, 400, -100)
    assert position.lat == pytest.approx(450_000_000 + 100 / 0.011131884502145034, abs=1)
    east_scale = 0.011131884502145034 * math.cos(math.radians(45.0 + 50 / 111318.8))
    assert position.lon == pytest.approx(100_000_000 - 50 / east_scale, abs=1)
    assert position.hdg == pytest.approx(math.degrees(0.5) * 100, abs=1)
    assert (hud.groundspeed, hud.airspeed, hud.climb, hud.alt) == pytest.approx((5.0, 6.0, 1.0, 130.0))
    assert attitude.yaw == pytest.approx(0.5)
    assert local.x == pytest.approx(100.0)
    assert ready.autopilot.vehicle.alt_rel_m == pytest.approx(30.0)


# --- parameters ---


def test_parameter_list_is_complete(ready: Bench) -> None:
    ready.say(dialect.MAVLink_param_request_list_message(7, 1))
    ready.run(1.0)
    values = [m for m in ready.heard if m.get_type() == "PARAM_VALUE"]
    assert [m.param_index for m in values] == list(range(values[0].param_count))
    assert {"MAV_SYSID", "WPNAV_SPEED", "RTL_ALT"} <= {m.param_id for m in values}


def test_parameter_read_and_set(ready: Bench) -> None:
    def read(name: str) -> list[float]:
        answer = ready.say(dialect.MAVLink_param_request_read_message(7, 1, name.encode(), -1))
        return [m.param_value for m in answer]

    assert read("WPNAV_SPEED") == [1000.0]
    answer = ready.say(dialect.MAVLink_param_set_message(7, 1, b"WPNAV_SPEED", 650.0, 9))
    assert [(m.param_id, m.param_value, m.param_type) for m in answer] == [("WPNAV_SPEED", 650.0, 9)]
    ready.run(0.1)
    assert speeds(ready)[0] == 10.0, "in GUIDED it counts from the next kind of target on"
    ready.command(176, 1, RTL)
    assert speeds(ready)[0] == 6.5
    assert ready.say(dialect.MAVLink_param_set_message(7, 1, b"WPNAV_SPEED", math.nan, 9)) == []
    assert ready.say(dialect.MAVLink_param_set_message(7, 1, b"NOPE", 1.0, 9)) == []
    assert read("WPNAV_SPEED") == [650.0]
    assert read("NOPE") == []
    for value, kept in ((2000.6, 2000.0), (2000.995, 2001.0), (-2.7, -2.0)):  # as AP_Param::set_float
        answer = ready.say(dialect.MAVLink_param_set_message(7, 1, b"RTL_ALT", value, 6))
        assert [m.param_value for m in answer] == [kept]
    assert read("MAV_SYSID") == [7.0]


def test_unknown_parameters_and_values_are_a_callers_mistake() -> None:
    parameters = StandinParameters()
    with pytest.raises(UnknownParameterError):
        parameters.set("NOPE", 1.0)
    with pytest.raises(ValueError, match="RTL_ALT: nan is not a finite number"):
        parameters.set("RTL_ALT", math.nan)
    assert parameters.set("FRAME_CLASS", 1e9) == 127.0


# --- missions ---


def item(
    seq: int,
    command: int = 16,
    frame: int = 3,
    lat: int = 450_000_000,
    lon: int = 100_000_000,
    alt: float = 20.0,
    parameters: tuple[float, ...] = (0, 0, 0, 0),
) -> Any:
    return dialect.MAVLink_mission_item_int_message(
        7, 1, seq, frame, command, 0, 1, *parameters, lat, lon, alt, 0
    )


def upload(bench: Bench, items: list[Any]) -> list[Any]:
    answer = bench.say(dialect.MAVLink_mission_count_message(7, 1, len(items), 0))
    while answer and answer[0].get_type() == "MISSION_REQUEST":
        answer = bench.say(items[answer[0].seq])
    return answer


def test_mission_upload_download_and_clear(ready: Bench) -> None:
    answer = upload(ready, [item(0, frame=0), item(1, 22), item(2, lat=450_010_000), item(3, 20, frame=2)])
    assert (answer[0].get_type(), answer[0].type) == ("MISSION_ACK", 0)
    assert texts(answer) == ["Flight plan received"]
    assert [m.count for m in ready.say(dialect.MAVLink_mission_request_list_message(7, 1, 0))] == [4]
    (second,) = ready.say(dialect.MAVLink_mission_request_int_message(7, 1, 2, 0))
    assert (second.seq, second.command, second.x, second.y, second.z) == (
        2,
        16,
        450_010_000,
        100_000_000,
        20.0,
    )
    (old,) = ready.say(dialect.MAVLink_mission_request_message(7, 1, 2, 0))
    assert (old.get_type(), old.seq, old.command, old.z) == ("MISSION_ITEM", 2, 16, 20.0)
    assert old.x == pytest.approx(45.001, abs=1e-5)
    (home,) = ready.say(dialect.MAVLink_mission_request_int_message(7, 1, 0, 0))
    assert (home.x, home.y, home.z) == (450_000_000, 100_000_000, 100.0)
    assert [m.type for m in ready.say(dialect.MAVLink_mission_request_int_message(7, 1, 9, 0))] == [13]
    assert [m.seq for m in ready.say(dialect.MAVLink_mission_set_current_message(7, 1, 2))] == [2]
    assert ready.say(dialect.MAVLink_mission_set_current_message(7, 1, 77)) == []
    assert [m.type for m in ready.say(dialect.MAVLink_mission_clear_all_message(7, 1, 0))] == [0]
    assert [m.count for m in ready.say(dialect.MAVLink_mission_request_list_message(7, 1, 0))] == [0]


@pytest.mark.parametrize(
    ("bad", "result"),
    [
        (item(1, 9999), 3),
        (item(1, 16, frame=10), 2),
        (item(1, lat=910_000_000), 10),
        (item(1, lon=1_900_000_000), 11),
        (item(5), 13),
        (item(1, alt=83_000.0), 12),
        (item(1, parameters=(math.nan, 0, 0, 0)), 6),
        (item(1, parameters=(0, math.nan, 0, 0)), 7),
        (item(1, parameters=(0, 0, math.nan, 0)), 8),
        (item(1, parameters=(0, 0, 0, math.inf)), 9),
        (item(1, 19, parameters=(0, 0, 0, math.nan)), 9),
        (item(1, 178, frame=2, parameters=(1, 5, 0, math.nan)), 9),
    ],
)
def test_bad_items_are_refused_and_change_nothing(ready: Bench, bad: Any, result: int) -> None:
    upload(ready, [item(0), item(1)])
    ready.say(dialect.MAVLink_mission_count_message(7, 1, 3, 0))
    ready.say(item(0))
    assert [m.type for m in ready.say(bad)] == [result]
    assert len(ready.autopilot.vehicle.mission) == 2


@pytest.mark.parametrize("command", [16, 21, 22])
def test_a_yaw_may_be_left_open_as_in_arducopter(ready: Bench, command: int) -> None:
    answer = upload(ready, [item(0), item(1, command, parameters=(0, 0, 0, math.nan))])
    assert (answer[0].get_type(), answer[0].type) == ("MISSION_ACK", 0)


def test_home_can_be_read_without_a_mission(ready: Bench) -> None:
    (home,) = ready.say(dialect.MAVLink_mission_request_int_message(7, 1, 0, 0))
    assert (home.command, home.frame, home.x, home.y, home.z) == (16, 0, 450_000_000, 100_000_000, 100.0)
    assert [m.count for m in ready.say(dialect.MAVLink_mission_request_list_message(7, 1, 0))] == [0]


def old_item(seq: int, command: int, *place: float) -> Any:
    return dialect.MAVLink_mission_item_message(7, 1, seq, 3, command, 0, 1, 0, 0, 0, 0, *place, 0)


def test_old_clients_upload_items_with_degrees(ready: Bench) -> None:
    """As MAVProxy did once, and dronekit does."""
    items = [item(0, frame=0), old_item(1, 16, 45.001, 10.5, 20.0), old_item(2, 178, 1.0, math.nan, 0.0)]
    answer = upload(ready, items)
    assert (answer[0].get_type(), answer[0].type) == ("MISSION_ACK", 0)
    (first,) = ready.say(dialect.MAVLink_mission_request_int_message(7, 1, 1, 0))
    assert (first.x, first.y) == pytest.approx((450_010_000, 105_000_000), abs=40)
    (setting,) = ready.say(dialect.MAVLink_mission_request_int_message(7, 1, 2, 0))
    assert (setting.command, setting.x) == (178, 1), "only places are degrees"
    bad = [item(0, frame=0), old_item(1, 16, math.inf, 10.5, 20.0)]
    assert [m.type for m in upload(ready, bad)] == [dialect.MAV_MISSION_INVALID_PARAM5_X]


def test_an_upload_asks_again_and_is_given_up(ready: Bench) -> None:
    ready.say(dialect.MAVLink_mission_count_message(7, 1, 3, 0))
    told = ready.run(10.0)
    assert texts(told) == ["Mission upload timeout"]
    heard = [m for m in told if m.get_type().startswith("MISSION")]
    assert {(m.get_type(), getattr(m, "seq", None)) for m in heard[:-1]} == {("MISSION_REQUEST", 0)}
    assert 6 <= len(heard) - 1 <= 8
    assert (heard[-1].get_type(), heard[-1].type) == ("MISSION_ACK", dialect.MAV_MISSION_OPERATION_CANCELLED)


def test_a_stray_item_and_too_many_items_are_refused(ready: Bench) -> None:
    assert [m.type for m in ready.say(item(0))] == [1]
    assert [m.type for m in ready.say(dialect.MAVLink_mission_count_message(7, 1, 5000, 0))] == [4]


FENCE, RALLY, ALL = 1, 2, 255


def of_kind(kind: int, seq: int, command: int, **changes: Any) -> Any:
    message = item(seq, command, **{"frame": 5, **changes})
    message.mission_type = kind
    return message


def corner(seq: int, vertices: float, command: int = 5001) -> Any:
    return of_kind(FENCE, seq, command, lat=450_000_000 + 1000 * seq, parameters=(vertices, 0, 0, 0))


def circle(seq: int, radius_m: float) -> Any:
    return of_kind(FENCE, seq, 5003, parameters=(radius_m, 0, 0, 0))


@pytest.mark.parametrize(
    ("fence", "text"),
    [
        ([corner(seq, 2) for seq in range(2)], "Invalid vertex count (2)"),
        ([corner(seq, 3) for seq in range(4)], "Incorrect item count"),
        ([corner(seq, 5) for seq in range(4)], "Incorrect item count"),
        ([corner(0, 4), corner(1, 3)], "Unexpected vertex count want=4 got=3"),
        ([corner(0, 3), corner(1, 3), corner(2, 3, 5002)], "Received incorrect vertex type"),
        ([corner(0, 3), circle(1, 9.0)], "Received incorrect type"),
        ([circle(0, 0.0)], "Non-positive circle radius"),
        ([of_kind(FENCE, 0, 5000), of_kind(FENCE, 1, 5000)], "Multiple return points"),
    ],
)
def test_a_fence_that_arducopter_refuses_is_refused_with_its_words(
    ready: Bench, fence: list[Any], text: str
) -> None:
    answer = upload_kind(ready, FENCE, fence)
    assert (answer[0].get_type(), answer[0].type) == ("MISSION_ACK", dialect.MAV_MISSION_ERROR)
    assert texts(answer) == [text, "Fence validation failed"]
    (told,) = ready.say(dialect.MAVLink_mission_request_list_message(7, 1, FENCE))
    assert told.count == 0


@pytest.mark.parametrize("bad", [corner(0, 300), corner(0, math.nan), circle(0, math.nan)])
def test_a_fence_item_whose_number_makes_no_sense_is_refused_at_once(ready: Bench, bad: Any) -> None:
    answer = upload_kind(ready, FENCE, [bad, bad])
    assert [m.type for m in answer] == [dialect.MAV_MISSION_INVALID_PARAM1]


def test_heights_of_fences_are_not_kept_and_those_of_rally_points_in_16_bits(ready: Bench) -> None:
    high = of_kind(RALLY, 0, 5100, alt=40_000.0)
    assert [m.type for m in upload_kind(ready, RALLY, [high])] == [dialect.MAV_MISSION_INVALID_PARAM7]
    fence = of_kind(FENCE, 0, 5003, alt=1e6, parameters=(50, 0, 0, 0))
    assert [m.type for m in upload_kind(ready, FENCE, [fence])] == [0]


def test_lists_are_uploaded_apart_and_nobody_ends_the_upload_of_another(ready: Bench) -> None:
    """As ArduPilot's MissionItemProtocol, of which there is one for each kind."""
    ready.say(dialect.MAVLink_mission_count_message(7, 1, 2, 0))
    assert [m.count for m in ready.say(dialect.MAVLink_mission_request_list_message(7, 1, FENCE))] == [0]
    assert [m.type for m in ready.say(dialect.MAVLink_mission_clear_all_message(7, 1, FENCE))] == [0]
    upload_kind(ready, RALLY, [of_kind(RALLY, 0, 5100)])
    other, ready.client = ready.client, dialect.MAVLink(None, 254, 190)
    for message in (
        dialect.MAVLink_mission_clear_all_message(7, 1, 0),
        dialect.MAVLink_mission_count_message(7, 1, 0, 0),
    ):
        assert [m.type for m in ready.say(message)] == [dialect.MAV_MISSION_DENIED]
    ready.client = other
    assert [m.seq for m in ready.say(item(0))] == [1]
    assert ready.say(item(1))[0].type == dialect.MAV_MISSION_ACCEPTED


def upload_kind(bench: Bench, kind: int, items: list[Any]) -> list[Any]:
    answer = bench.say(dialect.MAVLink_mission_count_message(7, 1, len(items), kind))
    for one in items:
        if answer[0].get_type() == "MISSION_REQUEST":
            answer = bench.say(one)
    return answer


def test_fences_and_rally_points_are_kept_and_given_back_beside_the_mission(ready: Bench) -> None:
    upload(ready, [item(0), item(1)])
    fence = [corner(seq, 4) for seq in range(4)]
    rally = [of_kind(RALLY, 0, 5100)]
    for kind, items in ((FENCE, fence), (RALLY, rally)):
        answer = ready.say(dialect.MAVLink_mission_count_message(7, 1, len(items), kind))
        for seq, one in enumerate(items):
            assert [(m.get_type(), m.seq, m.mission_type) for m in answer] == [("MISSION_REQUEST", seq, kind)]
            answer = ready.say(one)
        assert [(m.get_type(), m.type, m.mission_type) for m in answer] == [("MISSION_ACK", 0, kind)]
    for kind, items in ((FENCE, fence), (RALLY, rally)):
        (told,) = ready.say(dialect.MAVLink_mission_request_list_message(7, 1, kind))
        assert (told.count, told.mission_type) == (len(items), kind)
        for one in items:
            (back,) = ready.say(dialect.MAVLink_mission_request_int_message(7, 1, one.seq, kind))
            assert (back.seq, back.command, back.x, back.y, back.mission_type) == (
                one.seq,
                one.command,
                one.x,
                one.y,
                kind,
            )
    assert [m.type for m in ready.say(dialect.MAVLink_mission_request_int_message(7, 1, 9, FENCE))] == [13]
    ready.say(dialect.MAVLink_mission_count_message(7, 1, 1, FENCE))
    assert [m.type for m in ready.say(of_kind(FENCE, 0, 16))] == [3], "a way point is no part of a fence"
    assert [m.type for m in ready.say(dialect.MAVLink_mission_clear_all_message(7, 1, FENCE))] == [0]
    counts = [
        ready.say(dialect.MAVLink_mission_request_list_message(7, 1, kind))[0].count for kind in range(3)
    ]
    assert counts == [2, 0, 1]
    assert [m.type for m in ready.say(dialect.MAVLink_mission_clear_all_message(7, 1, ALL))] == [3]
    assert len(ready.autopilot.vehicle.mission) == 2
    assert [m.type for m in ready.say(dialect.MAVLink_mission_count_message(7, 1, 3, 3))] == [3]


def in_the_air(ready: Bench) -> Bench:
    """Hold 20 m over home."""
    ready.command(400, 1)
    ready.pose = {"position": [0.0, 0.0, -20.0]}
    ready.turn()
    ready.autopilot.vehicle.leave_ground()
    return ready


def test_a_mission_that_is_cleared_in_flight_leaves_the_way_home_open(ready: Bench) -> None:
    upload(ready, [item(0), item(1, lat=451_000_000)])
    in_the_air(ready)
    assert results(ready.command(176, 1, AUTO)) == [(176, 0)]
    ready.run(0.5)

    def cleared() -> list[int]:
        return [m.type for m in ready.say(dialect.MAVLink_mission_clear_all_message(7, 1, 0))]

    assert cleared() == [dialect.MAV_MISSION_ERROR], "while it is flown"
    assert len(ready.autopilot.vehicle.mission) == 2
    ready.command(176, 1, GUIDED)
    assert cleared() == [dialect.MAV_MISSION_ACCEPTED]
    for mode in (RTL, 9, GUIDED, AUTO):
        answer = ready.command(176, 1, mode)
        assert results(answer) == [(176, 4 if mode == AUTO else 0)], mode
    assert texts(answer) == ["Mode change to AUTO failed: no mission"]


def test_a_mission_that_ends_with_a_setting_completes(ready: Bench) -> None:
    upload(ready, [item(0), item(1, 19), item(2, 178)])
    in_the_air(ready)
    ready.command(511, 42, 100_000)
    assert results(ready.command(176, 1, AUTO)) == [(176, 0)]
    ready.run(1.0)
    assert reached(ready) == [1]
    assert current(ready) == (1, dialect.MISSION_STATE_COMPLETE, 1)
    # Entered again, a mission that is complete begins anew.
    ready.heard.clear()
    ready.command(176, 1, GUIDED)
    ready.command(176, 1, AUTO)
    ready.run(1.0)
    assert reached(ready) == [1]


def reached(bench: Bench) -> list[int]:
    return [m.seq for m in bench.heard if m.get_type() == "MISSION_ITEM_REACHED"]


def current(bench: Bench) -> tuple[int, int, int]:
    """Number, state of the mission, and whether AUTO flies."""
    (told,) = [m for m in bench.command(512, 42) if m.get_type() == "MISSION_CURRENT"]
    return told.seq, told.mission_state, told.mission_mode


def test_a_setting_hides_the_item_before_it(ready: Bench) -> None:
    """Real ArduCopter says of loiter 1, speeds 2 and 3, and loiter 4 that 2, 3 and 4 were reached."""
    speeds_on = [item(seq, 178, frame=2, parameters=(1, 5.0, 0, 0)) for seq in (2, 3)]
    upload(ready, [item(0), item(1, 19), *speeds_on, item(4, 19)])
    in_the_air(ready)
    ready.command(176, 1, AUTO)
    ready.run(1.0)
    assert reached(ready) == [2, 3, 4]
    assert [text for text in texts(ready.heard) if text.startswith("Reached")] == [
        "Reached command #1",
        "Reached command #4",
    ]


def test_a_mission_that_is_stopped_goes_on_where_it_was_also_another(ready: Bench) -> None:
    """As real ArduCopter: an upload neither starts a mission nor sends it back to its start."""
    far = [item(seq, lat=450_000_000 + 20_000 * seq) for seq in (1, 2, 3)]
    upload(ready, [item(0), item(1, 19), *far[1:]])
    in_the_air(ready)
    assert current(ready) == (0, dialect.MISSION_STATE_NOT_STARTED, 0)
    ready.command(176, 1, AUTO)
    ready.run(0.1)
    assert current(ready) == (2, dialect.MISSION_STATE_ACTIVE, 1)
    ready.command(176, 1, GUIDED)
    assert current(ready) == (2, dialect.MISSION_STATE_NOT_STARTED, 0)
    upload(ready, [item(0), *far])
    assert current(ready)[0] == 2
    ready.command(176, 1, AUTO)
    ready.run(0.1)
    assert current(ready) == (2, dialect.MISSION_STATE_ACTIVE, 1)
    vehicle = ready.autopilot.vehicle
    assert vehicle.navigator.target_ned_m()[0] == pytest.approx(445.3, abs=0.1)
    answer = upload(ready, [item(0), far[0], item(2, lat=450_010_000), far[2]])
    assert "Auto mission changed, restarted command" in texts([*answer, *ready.run(0.1)])
    assert vehicle.navigator.target_ned_m()[0] == pytest.approx(111.3, abs=0.1)
    ready.command(224, 3)
    ready.run(0.1)
    assert current(ready)[0] == 3
    ready.command(176, 1, GUIDED)
    upload(ready, [item(0), far[0]])
    ready.command(176, 1, AUTO)
    ready.run(0.1)
    assert current(ready)[0] == 1, "there is no third item any more"


def test_a_mission_that_is_complete_waits_for_auto(ready: Bench) -> None:
    """Another mission, or another item of it, is not flown before: real ArduCopter stayed where it was."""
    upload(ready, [item(0), item(1, 19)])
    in_the_air(ready)
    ready.command(176, 1, AUTO)
    ready.run(0.1)
    assert current(ready) == (1, dialect.MISSION_STATE_COMPLETE, 1)
    ready.heard.clear()
    upload(ready, [item(0), item(1, 19), item(2, 19)])
    ready.run(0.1)
    assert current(ready) == (1, dialect.MISSION_STATE_COMPLETE, 1)
    ready.command(224, 0)
    ready.run(0.1)
    assert current(ready) == (1, dialect.MISSION_STATE_NOT_STARTED, 1), "home stands for the first item"
    assert reached(ready) == []
    ready.command(224, 2)
    assert results(ready.command(300)) == [(300, 0)]
    ready.run(0.1)
    assert reached(ready) == [2]


@pytest.mark.parametrize(
    ("commands", "told", "state"),
    [
        pytest.param((22, 21), [1], (1, dialect.MISSION_STATE_ACTIVE, 1), id="LAND"),
        pytest.param((22, 21, 16, 21), [1], (1, dialect.MISSION_STATE_ACTIVE, 1), id="LAND and more"),
        pytest.param((22, 20), [1, 2], (0, dialect.MISSION_STATE_COMPLETE, 1), id="RTL"),
        pytest.param((22, 20, 16, 21), [1, 2], (1, dialect.MISSION_STATE_ACTIVE, 1), id="RTL and more"),
    ],
)
def test_after_a_landing_a_mission_begins_anew(
    ready: Bench, commands: tuple[int, ...], told: list[int], state: tuple[int, int, int]
) -> None:
    """As real ArduCopter: what is after a landing is not flown; with more after RTL it stands until DISARM_DELAY."""
    upload(ready, [item(0), *(item(seq, command) for seq, command in enumerate(commands, 1))])
    in_the_air(ready)
    ready.command(176, 1, AUTO)
    ready.run(0.1)
    vehicle = ready.autopilot.vehicle
    vehicle.landed = True
    vehicle.mode.touched_ground()
    ready.run(11.0)
    assert not vehicle.armed
    assert reached(ready) == told
    assert current(ready) == state
    ready.pose = {}
    ready.command(176, 1, GUIDED)
    ready.command(400, 1)
    ready.command(300)
    ready.run(0.1)
    assert texts(ready.heard)[-1] == "Mission: 1 Takeoff"


def test_auto_leaves_the_ground_by_a_takeoff_alone(ready: Bench) -> None:
    upload(ready, [item(0), item(1, 178, frame=2), item(2)])
    ready.command(400, 1)
    answer = ready.command(300)
    assert results(answer) == [(300, 4)]
    assert texts(answer) == ["Auto: Missing Takeoff Cmd", "Mode change to AUTO failed: init failed"]
    upload(ready, [item(0), item(1, 178, frame=2), item(2, 22)])
    assert results(ready.command(300, 2)) == [(300, 2)], "it has no first and last item"
    assert results(ready.command(300)) == [(300, 0)]


def without_height(message: Any) -> Any:
    message.z = 0.0
    return message


@pytest.mark.parametrize("frame", [0, 3])
def test_an_item_without_a_height_or_a_place_keeps_that_of_before(ready: Bench, frame: int) -> None:
    """As ArduCopter: it flew into the ground."""
    vehicle = ready.autopilot.vehicle
    here = item(3, frame=3, lat=0, lon=0)
    far = [without_height(item(seq, frame=frame, lat=450_000_000 + 10_000 * seq)) for seq in (1, 2)]
    upload(ready, [item(0), *far, here, without_height(item(4, 21, frame=3, lat=0, lon=0))])
    in_the_air(ready)
    ready.pose = {"position": [0.0, 0.0, -35.0]}
    ready.turn()
    ready.command(176, 1, AUTO)
    ready.run(0.02)
    first = vehicle.navigator.target_ned_m()
    assert first == pytest.approx((111.32, 0.0, -35.0), abs=0.01)
    ready.pose = {"position": [first[0] + 1.0, 0.5, -35.8]}
    ready.run(0.02)
    second = vehicle.navigator.target_ned_m()
    assert second == pytest.approx((222.64, 0.0, -35.0), abs=0.01), "the point before counts, when reached"
    ready.pose = {"position": [second[0] - 1.0, 0.5, -35.8]}
    ready.run(0.02)
    assert vehicle.navigator.target_ned_m() == pytest.approx((*second[:2], -20.0), abs=0.01)
    ready.pose = {"position": [second[0] - 1.0, 0.5, -20.5]}
    ready.run(0.1)
    assert (vehicle.landing, vehicle.navigator.point_m) == (True, None), "it lands where it can stop"


def test_a_takeoff_without_a_height_rises_a_metre(ready: Bench) -> None:
    upload(ready, [item(0), without_height(item(1, 22))])
    ready.command(176, 1, GUIDED)
    ready.command(400, 1)
    ready.command(300)
    ready.run(0.1)
    mode = ready.autopilot.vehicle.mode
    assert isinstance(mode, Auto)
    assert mode._takeoff is not None
    assert mode._takeoff.down_m == pytest.approx(-1.0, abs=0.01)


@pytest.mark.parametrize(
    ("position_m", "north_mps", "slope", "height_m"),
    [
        pytest.param((0.0, 0.0, -5.0), 0.0, 3.0, 5.0, id="over home it does not climb"),
        pytest.param((4.0, 0.0, -5.0), 0.0, 3.0, 12.0, id="in the cone"),
        pytest.param((0.0, 9.0, -5.0), 0.0, 3.0, 15.0, id="beyond"),
        pytest.param((1.0, 0.0, -5.0), 2.0, 3.0, 9.0, id="stops 2 m on"),
        pytest.param((1.0, 0.0, -2.0), -4.0, 3.0, 10.35, id="stops 4.45 m on, beyond home"),
        pytest.param((0.0, 0.0, -5.0), 0.0, 0.4, 15.0, id="too shallow a cone"),
        pytest.param((0.2, 0.0, -1.0), 0.0, 3.0, 1.0, id="low"),
        pytest.param((90.0, 0.0, -40.0), 0.0, 3.0, 40.0, id="high"),
    ],
)
def test_the_height_of_the_return(
    ready: Bench, position_m: tuple[float, float, float], north_mps: float, slope: float, height_m: float
) -> None:
    """ModeRTL::compute_return_target; the real one stays at 5 m over home, too."""
    vehicle = ready.autopilot.vehicle
    vehicle.parameters.set("RTL_CONE_SLOPE", slope)
    ready.command(400, 1)
    ready.pose = {"position": position_m, "velocity": [north_mps, 0.0, 0.0]}
    ready.turn()
    vehicle.leave_ground()
    ready.command(176, 1, RTL)
    assert vehicle.navigator.depth_m == pytest.approx(-height_m, abs=0.01)


@pytest.mark.parametrize(
    ("yaw_behavior", "way_deg", "home_deg"), [(0, 0, 0), (1, 180, 0), (2, 0, 0), (3, 180, 0)]
)
def test_the_nose_on_the_way_home(ready: Bench, yaw_behavior: int, way_deg: float, home_deg: float) -> None:
    """As real ArduCopter turned: homewards, and at home to where it was at arming."""
    vehicle = in_the_air(ready).autopilot.vehicle
    vehicle.parameters.set("WP_YAW_BEHAVIOR", yaw_behavior)
    vehicle.parameters.set("RTL_LOIT_TIME", 0)
    ready.pose = {"position": [90.0, 0.0, -20.0]}
    ready.turn()
    ready.command(176, 1, RTL)
    ready.run(8.0)
    assert abs(math.degrees(vehicle.navigator.yaw_rad)) == pytest.approx(way_deg, abs=1.0)
    ready.pose = {"position": [0.0, 0.0, -20.0]}
    if way_deg:
        for _ in range(2000):
            ready.turn(quaternion=[0.0, 0.0, 0.0, 1.0])
        assert not vehicle.landing, "it waits for its nose"
    ready.run(0.1)
    assert vehicle.landing
    assert math.degrees(vehicle.navigator.yaw_rad) == pytest.approx(home_deg, abs=1.0)


def test_a_missions_speed_ends_with_its_way_home(ready: Bench) -> None:
    """RTL_SPEED 0 is WPNAV_SPEED: real ArduCopter flew home at 7 m/s after a speed of 3."""
    slow = item(1, 178, frame=2, parameters=(1, 3.0, 0, 0))
    upload(ready, [item(0), slow, item(2, 19), item(3, 20, frame=2)])
    in_the_air(ready)
    ready.pose = {"position": [0.0, 0.0, -20.0]}
    ready.command(176, 1, AUTO)
    ready.run(1.0)
    assert ready.autopilot.vehicle.mission.current == 3
    assert speeds(ready)[0] == 10.0


def test_brake_stops_where_the_vehicle_is(ready: Bench) -> None:
    in_the_air(ready)
    vehicle = ready.autopilot.vehicle
    vehicle.mode.fly_to((100.0, 0.0, -20.0))  # type: ignore[attr-defined]
    assert results(ready.command(176, 1, 17)) == [(176, 0)]
    assert vehicle.navigator.point_m is None
    assert [m.custom_mode for m in ready.run(1.1) if m.get_type() == "HEARTBEAT"][-1] == 17
    assert texts(ready.command(176, 1, 0)) == ["Mode change to STABILIZE failed: no RC"]
    vehicle.landed = True
    vehicle.disarm(force=True)
    assert texts(ready.command(400, 1))[-1] == "Arm: BRAKE mode not armable"


# --- what the stand-in has not ---


def test_files_are_refused_at_once(ready: Bench) -> None:
    payload = [11, 0, 3, 4, 5, 0, 0, 0, 0, 0, 0, 0, *b"@PARAM", *([0] * 233)]  # OpenFileRO in session 3
    (answer,) = ready.say(dialect.MAVLink_file_transfer_protocol_message(0, 7, 1, payload))
    head = bytes(answer.payload[:13])
    assert (answer.target_system, answer.target_component) == (255, 190)
    assert (head[:2], head[2], head[3], head[4], head[5]) == (b"\x0c\0", 3, 129, 1, 4)
    assert head[12] == 7, "unknown command"
    payload[3] = 129
    assert ready.say(dialect.MAVLink_file_transfer_protocol_message(0, 7, 1, payload)) == []


def test_logs_are_none_at_once(ready: Bench) -> None:
    (entry,) = ready.say(dialect.MAVLink_log_request_list_message(7, 1, 0, 0xFFFF))
    assert (entry.get_type(), entry.num_logs) == ("LOG_ENTRY", 0)
    (data,) = ready.say(dialect.MAVLink_log_request_data_message(7, 1, 5, 90, 900))
    assert (data.get_type(), data.id, data.ofs, data.count) == ("LOG_DATA", 5, 90, 0)


@pytest.mark.parametrize(
    "message",
    [
        dialect.MAVLink_mission_write_partial_list_message(7, 1, 1, 2, 0),
        dialect.MAVLink_mission_request_partial_list_message(7, 1, 1, 2, 0),
    ],
)
def test_old_parts_of_the_mission_protocol_are_refused_at_once(ready: Bench, message: Any) -> None:
    assert [(m.get_type(), m.type) for m in ready.say(message)] == [("MISSION_ACK", 3)]


def test_the_fence_that_is_not_there_is_not_breached(ready: Bench) -> None:
    status = next(m for m in ready.command(512, 1) if m.get_type() == "SYS_STATUS")
    geofence = dialect.MAV_SYS_STATUS_GEOFENCE
    assert not status.onboard_control_sensors_present & geofence
    assert not status.onboard_control_sensors_enabled & geofence
    assert status.onboard_control_sensors_health & geofence


# --- command line ---


def test_a_home_south_of_the_equator_is_no_option() -> None:
    words = ["--home", "-35.3,149.1,584,0", "--sysid", "2", "+", "--home", "-34,-70,500,0"]
    first, second = (cli._parser().parse_args(one).home for one in cli._split(words))
    assert (first.lat_deg, first.lon_deg) == (-35.3, 149.1)
    assert (second.lat_deg, second.lon_deg) == (-34.0, -70.0)


# --- physics link ---


def test_frames_are_answered_once_and_time_is_the_sum_of_advances() -> None:
    link = FdmLink(400)

    def receive(datagram: bytes) -> bool:
        return link.receive(parse_sensor_frame(datagram))

    assert len(link.packet) == 40
    assert link.packet[:8] == bytes((0x1A, 0x48, 0x90, 0x01, 0, 0, 0, 0))
    assert receive(sensor_frame(0.01))
    assert link.sim_time_ns == 10_000_000
    link.answer([1500] * 16)
    packet = link.packet
    assert packet[4:8] == bytes((1, 0, 0, 0))
    assert packet[8:10] == bytes((0xDC, 0x05))
    assert not receive(sensor_frame(0.01))
    assert not receive(b"{}")
    assert receive(sensor_frame(0.0025))
    assert (link.step_s, link.sim_time_ns) == (0.0, 10_000_000)
    assert receive(sensor_frame(0.005))
    assert link.sim_time_ns == 12_500_000
    assert link.events == {"frames": 3, "duplicate": 1, "malformed": 1, "physics_resets": 1}
    assert link.packet == packet, "what goes out again in silence"


@pytest.mark.parametrize(
    "changes",
    [
        {"timestamp": -1.0},
        {"timestamp": "now"},
        {"position": [0.0, 0.0]},
        {"position": [0.0, 0.0, math.nan]},
        {"velocity": [math.inf, 0.0, 0.0]},
        {"quaternion": [0.0, 0.0, 0.0, 0.0]},
        {"imu": {"gyro": [0.0, 0.0, 0.0]}},
        {"imu": 3},
        {"airspeed": math.nan},
        {"airspeed": "fast"},
    ],
)
def test_implausible_frames_are_refused(changes: dict[str, Any]) -> None:
    assert parse_sensor_frame(sensor_frame(1.0)) is not None
    assert parse_sensor_frame(sensor_frame(1.0, **changes)) is None


def test_euler_angles_serve_where_there_is_no_quaternion() -> None:
    frame = json.loads(sensor_frame(1.0, attitude=[0.0, 0.0, 1.0]))
    del frame["quaternion"]
    parsed = parse_sensor_frame(json.dumps(frame).encode())
    assert parsed is not None
    assert parsed.attitude_wxyz == pytest.approx((math.cos(0.5), 0.0, 0.0, math.sin(0.5)))


def test_a_reset_of_the_physics_does_not_stop_the_autopilot(ready: Bench) -> None:
    vehicle = ready.autopilot.vehicle
    before_ns = vehicle.sim_time_ns
    ready.frames = 0
    ready.turn()
    assert vehicle.sim_time_ns == before_ns
    ready.turn()
    assert vehicle.sim_time_ns == before_ns + 2_500_000


def test_frames_are_those_of_pymavlink_for_fewer_calls() -> None:
    """Of zeros the first byte alone is sent."""
    codec, pymavlink = MavlinkCodec(7), dialect.MAVLink(None, 7, 1)
    for kind, number in product(dialect.mavlink_map.values(), (1, 0)):
        counts = dict(zip(kind.ordered_fieldnames, kind.array_lengths, strict=True))
        values = [
            b"x" * number if field_type == "char" else [number] * counts[field] if counts[field] else number
            for field, field_type in zip(kind.fieldnames, kind.fieldtypes, strict=True)
        ]
        theirs = kind(*values).pack(pymavlink)
        pymavlink.seq = (pymavlink.seq + 1) % 256
        assert codec.pack(kind(*values)) == theirs, kind
    heartbeat, same = (dialect.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3) for _ in range(2))
    assert calls_of(lambda: codec.pack(heartbeat)) < 0.8 * calls_of(lambda: same.pack(pymavlink))
