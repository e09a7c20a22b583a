"""The daemon's logic with an autopilot that is a few lines of the test."""

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from aps.config import DaemonConfig
from aps.core import Core
from aps.links.link import Link, Opening, Role
from aps.links.outbox import OutboxCounters
from aps.vehicle.streams import MAX_WISHES
from aps.wire.framer import Framer

S = 1_000_000_000
ARM, SET_MESSAGE_INTERVAL = 400, 511
ATTITUDE, VFR_HUD = 30, 74
ACCEPTED, FAILED = 0, 4


def link_of(number, queue, role):
    link = Link(f"link {number}", queue, Opening(role))
    link.id = number
    return link


class Bench:
    """A core, a clock, and an autopilot's mouth and ears."""

    def __init__(self, rates_hz=None, **core_options):
        self.now_ns = 0
        self.parser = mavlink.MAVLink(None)
        self.autopilot = mavlink.MAVLink(None, srcSystem=2, srcComponent=1)
        self.heard = []
        self.ends = []
        self.counters = OutboxCounters()
        config = DaemonConfig(autopilot="tcp:127.0.0.1:1", sysid=2, stream_rates_hz=rates_hz or {})
        self.core = Core(config, lambda: self.now_ns, lambda: None, **core_options)
        self.link = link_of(0, self, Role.AUTOPILOT)
        self.clients = {}
        self.core.link_opened(self.link, 0)

    def put(self, frame):
        self.heard += self.parser.parse_buffer(frame)

    def say(self, *messages):
        data = b""
        for message in messages:
            data += bytes(message.pack(self.autopilot))
            self.autopilot.seq = (self.autopilot.seq + 1) & 0xFF
        self.core.frames(self.link, self.link.receive(data, self.now_ns), self.now_ns)

    def heartbeat(self, armed=False):
        self.say(mavlink.MAVLink_heartbeat_message(2, 3, 0x59 | 0x80 * armed, 4, 4, 3))

    def ack(self, command, result=ACCEPTED, target=(2, 191)):
        self.say(mavlink.MAVLink_command_ack_message(command, result, 255, 0, *target))

    def clock(self, ms):
        self.say(mavlink.MAVLink_system_time_message(0, ms))

    def wait(self, seconds):
        self.now_ns += round(seconds * S)
        self.core.on_time(self.now_ns)

    def start(self, *arguments, **options):
        return self.core.vehicle.commands.start(
            *arguments, on_done=lambda result: self.ends.append(str(result)), **options
        )

    def commands(self, command):
        return [m for m in self.heard if m.get_type() == "COMMAND_LONG" and m.command == command]

    def client_says(self, message, link=1):
        station = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
        (frame,) = Framer().receive(bytes(message.pack(station)))
        self.core.frames(self.clients.get(link) or self.client(link), [frame], self.now_ns)

    def client(self, number, queue=None):
        self.clients[number] = link_of(number, queue or Nobody(), Role.CLIENT)
        self.core.link_opened(self.clients[number], self.now_ns)
        return self.clients[number]


class Nobody:
    def put(self, frame):
        pass

    def put_all(self, frames, size_bytes):
        pass


@pytest.fixture
def bench():
    bench = Bench()
    bench.heartbeat()
    return bench


def test_late_acknowledgement_of_a_retry_does_not_end_the_next_command_of_its_kind(bench):
    arming = bench.start("arm")
    bench.wait(1.0)  # no answer for a second: a second try
    bench.ack(ARM)
    bench.heartbeat(armed=True)
    assert arming.result.reached
    disarming = bench.start("disarm")
    bench.ack(ARM, ACCEPTED)  # of the second try to arm
    bench.ack(ARM, FAILED)
    bench.wait(0.5)
    assert disarming.result.outcome.value == "refused"
    assert bench.core.vehicle.acks.counters.late == 1


def test_acknowledgement_of_an_interrupted_command_is_not_its_successors(bench):
    bench.start("mode", "LOITER")
    landing = bench.start("land")
    bench.ack(176)
    assert landing.execution.request is not None
    assert bench.ends == ["mode interrupted: by land"]
    bench.ack(176)
    assert landing.execution.request is None


def test_an_acknowledgement_that_never_comes_costs_one_retry(bench):
    bench.start("mode", "LOITER")
    landing = bench.start("land")
    bench.ack(176)  # land's: the first was dropped by the autopilot
    bench.wait(1.0)
    bench.ack(176)
    assert landing.execution.request is None


def test_parameter_told_to_somebody_else_does_not_end_a_command(bench):
    bench.say(mavlink.MAVLink_heartbeat_message(1, 3, 0xD9, 0, 4, 3))  # a fixed wing, armed
    climbing = bench.start("takeoff", 80.0)
    bench.say(mavlink.MAVLink_param_value_message(b"TKOFF_ALT", 50.0, 9, 1, 0))
    assert bench.commands(176) == []
    bench.say(mavlink.MAVLink_param_value_message(b"TKOFF_ALT", 80.0, 9, 1, 0))
    assert len(bench.commands(176)) == 1
    climbing.cancel()


def test_late_acknowledgement_of_a_stream_request_does_not_shift_the_others():
    bench = Bench({ATTITUDE: 10.0, VFR_HUD: 4.0})
    bench.heartbeat()
    for seconds in (1.0, 2.0):
        bench.wait(seconds)
    assert [message.param1 for message in bench.commands(SET_MESSAGE_INTERVAL)] == [ATTITUDE] * 3
    bench.ack(SET_MESSAGE_INTERVAL, ACCEPTED)
    assert bench.commands(SET_MESSAGE_INTERVAL)[-1].param1 == VFR_HUD
    for _ in range(2):
        bench.ack(SET_MESSAGE_INTERVAL, ACCEPTED)  # of the other two tries
    assert not bench.core.vehicle.streams.idle
    bench.ack(SET_MESSAGE_INTERVAL, FAILED)
    assert bench.core.vehicle.streams.idle
    assert bench.core.vehicle.streams.refused == {VFR_HUD}


def test_answers_after_a_pause_go_to_the_requests_they_are_for():
    bench = Bench({ATTITUDE: 10.0, VFR_HUD: 4.0})
    bench.heartbeat()
    for _ in range(400):
        bench.wait(0.1)  # the simulation is paused; the daemon does not know
    asked = [message.param1 for message in bench.commands(SET_MESSAGE_INTERVAL)]
    assert set(asked) == {ATTITUDE, VFR_HUD}
    bench.heartbeat()
    for msg_id in asked:
        bench.ack(SET_MESSAGE_INTERVAL, FAILED if msg_id == VFR_HUD else ACCEPTED)
    for message in bench.commands(SET_MESSAGE_INTERVAL)[len(asked) :]:
        bench.ack(SET_MESSAGE_INTERVAL, FAILED if message.param1 == VFR_HUD else ACCEPTED)
    assert bench.core.vehicle.streams.refused == {VFR_HUD}


@pytest.mark.parametrize("target", [(255, 190), (0, 0)])
def test_answer_to_a_clients_own_request_is_not_ours(target):
    bench = Bench({ATTITUDE: 10.0})
    bench.heartbeat()
    bench.ack(SET_MESSAGE_INTERVAL)
    bench.client(1)
    bench.client_says(mavlink.MAVLink_command_long_message(2, 1, 511, 0, VFR_HUD, 1e5, 0, 0, 0, 0, 0))
    bench.client_says(mavlink.MAVLink_request_data_stream_message(2, 1, 11, 50, 1))
    bench.wait(0.0)
    assert bench.commands(SET_MESSAGE_INTERVAL)[-1].param2 == 20_000  # ours, for the data stream
    bench.ack(SET_MESSAGE_INTERVAL, FAILED, target)
    assert not bench.core.vehicle.streams.idle
    bench.ack(SET_MESSAGE_INTERVAL, ACCEPTED, (0, 0))
    assert bench.core.vehicle.streams.idle
    assert bench.core.vehicle.streams.refused == set()


def flying(**core_options):
    bench = Bench(**core_options)
    bench.heartbeat(armed=True)
    bench.clock(60_000)
    climbing = bench.start("takeoff", 100.0)
    bench.ack(176)
    bench.ack(22)
    assert climbing.execution.request is None
    return bench


def test_autopilot_that_falls_silent_does_not_hold_a_command_for_ever():
    bench = flying()
    bench.wait(599.0)
    assert bench.ends == []
    bench.wait(1.0)
    assert bench.ends == ["takeoff timed out: the autopilot's clock has stood still for 600 s"]


def test_autopilot_whose_clock_goes_on_is_not_silent():
    bench = flying(silence_s=30.0)
    for second in range(100):
        bench.wait(1.0)
        bench.clock(60_000 + 10 * second)  # a hundred times slower than the daemon's clock
    assert bench.ends == []
    for _ in range(31):
        bench.wait(1.0)
        bench.heartbeat(armed=True)  # tells no time
    assert bench.ends == ["takeoff timed out: the autopilot's clock has stood still for 30 s"]


def test_deadline_of_the_core_includes_the_silence():
    bench = flying(silence_s=0.25)
    bench.wait(0.0)  # our heartbeat is sent
    assert bench.core.deadline_ns() == S // 4


def test_the_autopilots_words_on_streams_that_it_lacks_reach_nobody_who_did_not_ask():
    bench = Bench({VFR_HUD: 5.0})
    queue = Kept()
    texts = []
    bench.core.vehicle.texts = texts.append
    bench.client(1, queue)
    bench.heartbeat()
    bench.say(no_stream(VFR_HUD), mavlink.MAVLink_statustext_message(6, b"No ap_message for mavlink id (30)"))
    bench.ack(SET_MESSAGE_INTERVAL, FAILED)
    bench.say(no_stream(VFR_HUD))  # it may come after the acknowledgement
    told = [message.text for message in queue.messages if message.get_type() == "STATUSTEXT"]
    assert told == ["No ap_message for mavlink id (30)"]
    assert [text.text for text in texts] == told
    assert bench.core.statistics()["hub"]["kept"] == 2


def no_stream(number):
    return mavlink.MAVLink_statustext_message(6, b"No ap_message for mavlink id (%d)" % number)


class Kept:
    def __init__(self):
        self.parser = mavlink.MAVLink(None)
        self.messages = []

    def put(self, frame):
        self.messages += self.parser.parse_buffer(frame)

    def put_all(self, frames, size_bytes):
        self.put(b"".join(frames))


class Ear:
    """A client that keeps what it is sent."""

    def __init__(self):
        self.parser = mavlink.MAVLink(None)
        self.heard = []

    def put(self, frame):
        self.heard += self.parser.parse_buffer(frame) or []

    def put_all(self, frames, size_bytes):
        self.put(b"".join(frames))

    def names(self):
        return [message.get_type() for message in self.heard]


def test_round_trips_are_measured_and_answers_to_them_kept_from_clients():
    bench = Bench(measures_latency=True)
    ear = Ear()
    bench.client(1, ear)
    for took_s in (0.004, 0.002):
        bench.heard.clear()
        bench.wait(1.0)
        (asked,) = [message for message in bench.heard if message.get_type() == "TIMESYNC"]
        assert (asked.tc1, asked.ts1) == (0, bench.now_ns)
        bench.now_ns += round(took_s * S)
        bench.say(mavlink.MAVLink_timesync_message(77, asked.ts1))
    assert "TIMESYNC" not in ear.names()
    bench.say(mavlink.MAVLink_timesync_message(77, 5))  # to somebody else's question
    bench.say(mavlink.MAVLink_timesync_message(0, 6))  # the autopilot's own question
    assert [message.ts1 for message in ear.heard if message.get_type() == "TIMESYNC"] == [5, 6]
    told = bench.link.latency.statistics()
    assert (told["asked"], told["answered"], told["latest_ms"], told["most_ms"]) == (2, 2, 2.0, 4.0)


def test_without_a_clock_of_its_own_nobody_is_asked_for_the_time(bench):
    bench.wait(1.0)
    assert "TIMESYNC" not in [message.get_type() for message in bench.heard]


def test_one_wish_too_many_is_denied_in_the_autopilots_name(bench):
    ear = Ear()
    bench.client(1, ear)

    def wish(msg_id):
        bench.client_says(
            mavlink.MAVLink_command_long_message(2, 1, SET_MESSAGE_INTERVAL, 0, msg_id, 1e6, 0, 0, 0, 0, 0)
        )

    for msg_id in range(1000, 1000 + MAX_WISHES):
        wish(msg_id)
    assert "COMMAND_ACK" not in ear.names()
    passed = len(bench.commands(SET_MESSAGE_INTERVAL))
    wish(5000)
    (ack,) = [message for message in ear.heard if message.get_type() == "COMMAND_ACK"]
    assert (ack.command, ack.result) == (SET_MESSAGE_INTERVAL, mavlink.MAV_RESULT_DENIED)
    assert (ack.get_srcSystem(), ack.get_srcComponent()) == (2, 1)
    assert len(bench.commands(SET_MESSAGE_INTERVAL)) == passed
    assert bench.core.statistics()["answers"]["denied"] == 1


@pytest.mark.parametrize("target", [(3, 1), (2, 100)])
def test_streams_of_others_behind_the_autopilots_link_are_theirs(bench, target):
    others = mavlink.MAVLink(None, srcSystem=target[0], srcComponent=target[1])
    raw = bytes(mavlink.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3).pack(others))
    bench.core.frames(bench.link, bench.link.framer.receive(raw), 0)
    bench.client(1)
    del bench.heard[:]
    group = mavlink.MAVLink_request_data_stream_message(*target, 0, 4, 1)
    interval = mavlink.MAVLink_command_long_message(*target, SET_MESSAGE_INTERVAL, 0, ATTITUDE, 500, *[0] * 5)
    bench.client_says(group)
    bench.client_says(interval)  # faster than this autopilot can
    passed = [message for message in bench.heard if message.get_srcSystem() == 255]
    assert [message.get_type() for message in passed] == ["REQUEST_DATA_STREAM", "COMMAND_LONG"]
    assert passed[1].param2 == 500
    assert bench.core.vehicle.streams.interval_us(ATTITUDE) == 0
    assert bench.core.vehicle.streams.counters.client_requests == 0


def lost(bench):
    return bench.core.autopilot_statistics(bench.now_ns)["lost_in"]


@pytest.mark.parametrize("at", [1, 100, 255])
def test_frames_of_a_new_boot_are_not_lost_whatever_number_the_old_one_was_at(at):
    bench = Bench()
    bench.autopilot.seq = at
    bench.clock(60_000)
    bench.autopilot.seq = (bench.autopilot.seq + 2) & 0xFF
    bench.clock(61_000)
    bench.autopilot.seq = 0
    bench.heartbeat()
    bench.clock(1_000)
    assert (bench.core.vehicle.telemetry.reboots, lost(bench)) == (1, 2)
    bench.heartbeat()
    bench.autopilot.seq += 3
    bench.clock(2_000)
    assert lost(bench) == 5


def test_a_second_link_loses_nothing_by_a_reboot_that_the_first_one_shows(bench):
    second = link_of(1, Nobody(), Role.AUTOPILOT)
    bench.core.link_opened(second, 0)
    by_second = mavlink.MAVLink(None, srcSystem=2, srcComponent=1)

    def say(seq):
        by_second.seq = seq
        raw = bytes(mavlink.MAVLink_heartbeat_message(2, 3, 0x59, 4, 4, 3).pack(by_second))
        bench.core.frames(second, second.receive(raw, bench.now_ns), bench.now_ns)

    bench.clock(60_000)
    say(100)
    bench.clock(1_000)
    say(0)
    bench.clock(2_000)
    say(1)
    assert second.traffic.lost == 0
    say(4)
    assert second.traffic.lost == 2


def test_only_the_autopilots_own_frames_are_missed(bench):
    """Of two links to it ArduPilot hands what comes by one to the other: some of our frames, not all."""
    ours = mavlink.MAVLink(None, srcSystem=2, srcComponent=191)
    station = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
    for seq in range(0, 90, 3):
        for sender in (ours, station):
            sender.seq = seq
            raw = bytes(mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3).pack(sender))
            bench.core.frames(bench.link, bench.link.receive(raw, 0), 0)
        bench.heartbeat()
    assert lost(bench) == 0
    bench.autopilot.seq += 2
    bench.heartbeat()
    assert lost(bench) == 2


def test_without_a_link_the_autopilot_is_not_connected_and_takes_no_command():
    bench = Bench()
    assert str(bench.start("arm").result) == "arm refused: the autopilot has not been heard"
    bench.heartbeat()
    bench.clock(60_000)
    state = bench.core.vehicle.telemetry.state
    assert state(bench.now_ns).connected
    arming = bench.start("arm")
    transfer = bench.start("parameter_get", "ANGLE_MAX")
    bench.core.link_closed(0, bench.now_ns)
    assert not state(bench.now_ns).connected
    assert bench.core.autopilot_statistics(bench.now_ns)["up"] is False
    assert str(arming.result) == "arm interrupted: no link to the autopilot"
    assert transfer.result is None
    assert str(bench.start("arm").result) == "arm refused: no link to the autopilot"
    bench.heard.clear()
    bench.wait(1.0)
    bench.core.link_opened(bench.link, bench.now_ns)
    bench.heartbeat()
    bench.wait(4.0)
    assert state(bench.now_ns).connected
    assert bench.commands(ARM) == []


def test_a_flight_that_was_accepted_is_followed_over_a_link_that_comes_back():
    bench = flying()
    bench.core.link_closed(0, bench.now_ns)
    bench.wait(29.0)
    bench.core.link_opened(bench.link, bench.now_ns)
    bench.wait(2.0)
    assert bench.ends == []
    bench.core.link_closed(0, bench.now_ns)
    bench.wait(30.0)
    assert bench.ends == ["takeoff timed out: no link to the autopilot for 30 s"]


def test_a_reboot_that_takes_the_link_away_before_it_is_acknowledged_is_reached():
    bench = Bench()
    bench.heartbeat()
    bench.clock(60_000)
    rebooting = bench.start("reboot")
    bench.core.link_closed(0, bench.now_ns)
    bench.wait(3.0)
    bench.core.link_opened(bench.link, bench.now_ns)
    bench.clock(1_000)
    assert rebooting.result.reached


def test_a_command_is_asked_for_by_another_link_that_takes_over(bench):
    second = link_of(1, bench, Role.AUTOPILOT)
    bench.core.link_opened(second, 0)
    arming = bench.start("arm")
    bench.core.link_closed(0, 0)
    bench.wait(1.0)
    assert arming.result is None
    assert len(bench.commands(ARM)) == 2
    assert bench.core.vehicle.telemetry.state(bench.now_ns).connected


class SecondLink:
    """Another autopilot's link, or another one to the same: it answers each TIMESYNC with a time of its own."""

    def __init__(self, bench, number, ahead_s, sysid=2):
        self.bench, self.ahead_ns = bench, round(ahead_s * S)
        self.counters = OutboxCounters()
        self.mav, self.parser = mavlink.MAVLink(None, srcSystem=sysid, srcComponent=1), mavlink.MAVLink(None)
        self.link = link_of(number, self, Role.AUTOPILOT)
        self.asked = []
        bench.core.link_opened(self.link, bench.now_ns)

    def put(self, frame):
        self.asked += [m.ts1 for m in self.parser.parse_buffer(frame) if m.get_type() == "TIMESYNC"]

    def answer(self):
        for ts1 in self.asked:
            message = mavlink.MAVLink_timesync_message(600 * S + self.ahead_ns + ts1, ts1)
            raw = bytes(message.pack(self.mav))
            self.bench.core.frames(self.link, self.link.receive(raw, self.bench.now_ns), self.bench.now_ns)
        self.asked.clear()


@pytest.mark.parametrize(
    ("ahead_s", "sysid", "are_two"),
    [(0.0, 2, False), (4.9, 2, False), (5.1, 2, True), (-300.0, 2, True), (-300.0, 3, False)],
)
def test_two_autopilots_of_one_system_id_are_told_once(caplog, ahead_s, sysid, are_two):
    bench = Bench(measures_latency=True)
    bench.core.link_closed(0, 0)
    links = SecondLink(bench, 1, 0.0), SecondLink(bench, 2, ahead_s, sysid)
    for _ in range(10):
        bench.wait(1.0)
        for link in links:
            link.answer()
    told = [record.message for record in caplog.records if "more than one" in record.message]
    assert told == are_two * [
        "more than one autopilot calls itself system 2, at link 1 and link 2: one of them alone is heard and commanded"
    ]


def test_one_autopilot_that_reboots_between_two_answers_is_one(caplog):
    bench = Bench(measures_latency=True)
    bench.core.link_closed(0, 0)
    first, second = SecondLink(bench, 1, 0.0), SecondLink(bench, 2, 0.0)
    for second_s in range(20):
        bench.wait(1.0)
        first.answer()
        if second_s == 10:
            first.ahead_ns = second.ahead_ns = -500 * S
        second.answer()
    assert "more than one" not in caplog.text


def test_a_speed_that_is_changed_on_the_way_to_a_local_point_is_not_changed_back():
    """The speed of `goto_ned` goes with its first five setpoints."""
    bench, change_speed, answered = Bench(), 178, 0
    bench.clock(1000)
    bench.heartbeat(armed=True)
    bench.start("goto_ned", 60.0, 0.0, -20.0, speed_mps=8.0)
    for second in range(1, 9):
        bench.clock(1000 + 1000 * second)
        bench.wait(1.0)
        if second == 1:
            bench.start("speed", 2.0)
        while answered < len(bench.commands(change_speed)):
            bench.ack(change_speed)
            answered += 1
    asked = [message.param2 for message in bench.commands(change_speed)]
    assert asked == [8.0] * (len(asked) - 1) + [2.0]
    assert 1 < len(asked) < 6
