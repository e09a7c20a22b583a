"""State at the ticks: stamped with the tick, and published at its rate at any tick rate."""

from __future__ import annotations

import dataclasses
from math import inf, isnan

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

import bridge.aircraft.aircraft_bridge
import bridge.host.api
import bridge.record.inputs.fields
from aps.config import DaemonConfig
from aps.held import HeldDaemon
from aps.links.kinds.called import CalledLink
from aps.vehicle.commander import VERBS
from aps.vehicle.execution import CommandProgress
from aps.vehicle.telemetry import Telemetry
from aps.wire.framer import Frame, Framer
from bridge.aircraft.aircraft_bridge import AGED, AircraftBridge, state_message
from bridge.aircraft.body import StatePace
from bridge.bus import messages
from bridge.bus.messages import CommandEvent, CommandGoal, decode, encode
from bridge.bus.messages.ages import GROUPS, age_s

S = 1_000_000_000


@pytest.fixture
def aircraft() -> AircraftBridge:
    return AircraftBridge(HeldDaemon(DaemonConfig(autopilot="tcp:127.0.0.1:1", sysid=1)), "0")


@pytest.mark.parametrize(
    ("tick_rate_hz", "per_s"), [(4, 4), (10, 10), (16, 10), (20, 10), (25, 10), (100, 10)]
)
def test_state_is_published_at_its_rate_at_any_tick_rate(
    aircraft: AircraftBridge, tick_rate_hz: int, per_s: int
) -> None:
    published, pace = 0, StatePace()
    for tick in range(20 * tick_rate_hz):
        now_ns = tick * 1_000_000_000 // tick_rate_hz
        aircraft.begin(now_ns)
        assert aircraft.state().header.stamp.ns == now_ns
        published += pace.is_due(now_ns)
        aircraft.end()
    assert published == 20 * per_s


@pytest.mark.parametrize(
    ("verb", "goal", "says"),
    [
        ("arm", CommandGoal(arguments='{"force": true}'), "arm has no argument 'force'"),
        ("dance", CommandGoal(), "dance"),
    ],
)
def test_what_cannot_be_done_is_told_at_once(
    aircraft: AircraftBridge, verb: str, goal: CommandGoal, says: str
) -> None:
    events: list[CommandEvent] = []
    aircraft.begin(0)
    aircraft.start(verb, goal, events.append)
    aircraft.end()
    [event] = events
    assert (event.phase, event.success) == (CommandEvent.RESULT, False)
    assert says in event.text


@pytest.mark.parametrize(
    ("verb", "arguments", "says"),
    [
        ("goto_ned", '{"up_m": 3}', "goto_ned has no argument 'up_m'"),
        ("parameter_get", '{"on_done": 3}', "parameter_get has no argument 'on_done'"),
        ("velocity", "[1, 2]", "arguments are a JSON object"),
        ("velocity", "north_mps: 1", "arguments are a JSON object, not 'north_mps: 1': Expecting value"),
        ("velocity", "{", "Expecting property name"),
        ("velocity", "[" * 100_000, "nested too deep"),
    ],
)
def test_wrong_arguments_are_refused_in_words(
    aircraft: AircraftBridge, verb: str, arguments: str, says: str
) -> None:
    events: list[CommandEvent] = []
    aircraft.start(verb, CommandGoal(arguments=arguments), events.append)
    [event] = events
    assert (event.phase, event.success, event.outcome) == (CommandEvent.RESULT, False, "refused")
    assert says in event.text


class Silent:
    """An autopilot that says a heartbeat when it is told to, and keeps what it hears."""

    def __init__(self) -> None:
        self.heard = b""
        self._said = b""

    def connect(self) -> None: ...

    def disconnect(self) -> None: ...

    def read(self) -> bytes:
        said, self._said = self._said, b""
        return said

    def write(self, data: bytes) -> None:
        self.heard += data

    def wake(self) -> None:
        self._said = bytes(
            mavlink.MAVLink_heartbeat_message(2, 3, 0x51, 4, 3, 3).pack(mavlink.MAVLink(None, 1, 1))
        )

    def commands(self) -> list[int]:
        heard = mavlink.MAVLink(None).parse_buffer(self.heard) or []
        return [message.command for message in heard if message.get_type() == "COMMAND_LONG"]


def early(autopilot: Silent) -> tuple[AircraftBridge, list[CommandEvent]]:
    """An aircraft that was commanded at 0 s, before its autopilot was heard, and lived until 29.9 s."""
    daemon = HeldDaemon(DaemonConfig(autopilot="tcp:127.0.0.1:1", sysid=1), autopilot=autopilot)
    assert isinstance(daemon.link, CalledLink)
    daemon.link.connect_now()
    aircraft, events = AircraftBridge(daemon, "0"), list[CommandEvent]()
    for tick in range(300):
        aircraft.begin(tick * S // 10)
        if tick == 0:
            aircraft.start("mode", CommandGoal(mode="GUIDED"), events.append)
            aircraft.start("arm", CommandGoal(), events.append)
        aircraft.end()
    assert events == []
    assert autopilot.commands() == []
    return aircraft, events


def test_commands_before_the_autopilot_is_heard_wait_for_it_and_start_in_their_order() -> None:
    autopilot = Silent()
    aircraft, events = early(autopilot)
    autopilot.wake()
    aircraft.begin(30 * S)
    aircraft.end()
    assert [command for command in autopilot.commands() if command != 511] == [176, 400]
    assert events == []
    aircraft.start("goto", CommandGoal(latitude_deg=100.0), events.append)
    assert events[0].text == "lat_deg must be in -90..90, not 100.0"


def test_commands_to_an_autopilot_that_is_never_heard_time_out() -> None:
    autopilot = Silent()
    aircraft, events = early(autopilot)
    aircraft.begin(30 * S)
    aircraft.end()
    assert [(event.phase, event.outcome, event.text) for event in events] == [
        (CommandEvent.RESULT, "timed_out", f"{verb} timed out: the autopilot has not been heard for 30 s")
        for verb in ("mode", "arm")
    ]
    autopilot.wake()
    aircraft.begin(31 * S)
    aircraft.end()
    assert len(events) == 2
    assert not {176, 400} & set(autopilot.commands())


def test_what_can_be_commanded_over_zenoh_is_what_aps_can_and_the_radio_and_is_said_once() -> None:
    assert (*VERBS, "radio") == bridge.record.inputs.fields.VERBS


def frames(*messages: mavlink.MAVLink_message) -> list[Frame]:
    mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    return Framer().receive(b"".join(bytes(message.pack(mav)) for message in messages))


def test_each_field_has_its_age() -> None:
    telemetry = Telemetry(1)
    said = {
        1: mavlink.MAVLink_heartbeat_message(2, 3, 0x59, 4, 4, 3),
        2: mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 12000, 0, 90, 0, 0, 0, 0, 0, 0),
        3: mavlink.MAVLink_attitude_message(1000, 0.1, 0, 0, 0, 0, 0),
        4: mavlink.MAVLink_global_position_int_message(1000, 1, 1, 0, 0, 0, 0, 0, 0),
        5: mavlink.MAVLink_local_position_ned_message(1000, 1, 2, 3, 0, 0, 0),
        6: mavlink.MAVLink_vfr_hud_message(1, 2, 3, 4, 5, 6),
        7: mavlink.MAVLink_battery_status_message(0, 0, 0, 0, [0] * 10, 5, 0, 0, 50),
    }
    for at_s, message in said.items():
        for frame in frames(message):
            telemetry.update(frame, at_s * S)
    message = decode(encode(state_message(telemetry.state(10 * S), "0", 10 * S)), messages.AircraftState)
    ages_s = {
        "mode": 9,
        "base_mode": 9,
        "armed": 9,
        "voltage_v": inf,  # and ready_to_arm waits for the estimator's word
        "euler_rad": 7,
        "latitude_deg": 6,
        "altitude_rel_m": 6,
        "position_ned_m": 5,
        "velocity_ned_mps": 5,
        "groundspeed_mps": 4,
        "throttle_percent": 4,
        "airspeed_mps": 4,  # no wind is known: it is the indicated one
        "wind_body_mps": inf,
        "current_a": 3,
        "flight_time_s": 5,
    }
    assert {name: age_s(message, name) for name in ages_s} == ages_s
    with pytest.raises(ValueError, match="'mav_id' is no field with an age"):
        age_s(message, "mav_id")
    assert isnan(age_s(messages.AircraftState(), "mode"))


def test_every_field_of_table_one_has_an_age_and_a_source() -> None:
    aged = {name for names in GROUPS.values() for name in names}
    fields = {field.name for field in dataclasses.fields(messages.AircraftState)}
    assert fields - aged == {"header", "mav_id", "heartbeat_age_s", "age_s"}
    assert list(GROUPS) == list(range(len(AGED)))


def test_a_mavlink_message_that_there_is_not_is_told_with_those_that_were_heard(
    aircraft: AircraftBridge,
) -> None:
    assert aircraft.last_message("ATTITUDE") is None
    with pytest.raises(ValueError, match=r"there is no MAVLink message 'NONSENSE'; heard so far: none$"):
        aircraft.last_message("NONSENSE")
    heard = mavlink.MAVLink_vfr_hud_message(0, 0, 0, 0, 0, 0), mavlink.MAVLink_system_time_message(0, 0)
    for frame in frames(*heard):
        aircraft.daemon.vehicle.messages.take(frame, 0)
    with pytest.raises(ValueError, match=r"heard so far: SYSTEM_TIME, VFR_HUD$"):
        aircraft.last_message("NONSENSE")


@pytest.mark.parametrize("refused", [True, False])
def test_that_a_part_of_a_command_is_refused_goes_to_agents_and_to_the_api(refused: bool) -> None:
    progress = CommandProgress("goto", "feedback", "DO_CHANGE_SPEED refused: FAILED", refused=refused)
    event = bridge.aircraft.aircraft_bridge._progress(progress)
    assert (event.phase, event.outcome) == (CommandEvent.FEEDBACK, "refused" if refused else "")
    assert bridge.host.api._progress("goto", event) == progress
