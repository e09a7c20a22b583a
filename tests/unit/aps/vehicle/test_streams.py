import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from aps.vehicle.streams import MAX_TRIES, MAX_WISHES, STREAM_GROUPS, StreamArbiter
from aps.wire.framer import Framer

S = 1_000_000_000
ATTITUDE, VFR_HUD, RAW_IMU = 30, 74, 27
ALICE, BOB = 1, 2


def client_frame(message, *, signed=False, sysid=255, compid=190):
    mav = mavlink.MAVLink(None, srcSystem=sysid, srcComponent=compid)
    if signed:
        mav.signing.secret_key, mav.signing.sign_outgoing = b"k" * 32, True
    (frame,) = Framer().receive(bytes(message.pack(mav)))
    return frame


def set_interval(msg_id, interval_us, **kwargs):
    message = mavlink.MAVLink_command_long_message(1, 1, 511, 0, msg_id, interval_us, 0, 0, 0, 0, 0)
    return client_frame(message, **kwargs)


def data_stream(stream, rate_hz, start=1):
    return client_frame(mavlink.MAVLink_request_data_stream_message(1, 1, stream, rate_hz, start))


def decoded(raw):
    (message,) = mavlink.MAVLink(None).parse_buffer(raw)
    return message


def drain(streams, now_ns=0, accepted=True):
    """Answer every request at once; returns what the autopilot was told."""
    told = {}
    while (request := streams.poll(now_ns)) is not None:
        told[request[0]] = request[1]
        streams.acknowledged(accepted)
    return told


@pytest.fixture
def streams():
    streams = StreamArbiter({ATTITUDE: 10.0, VFR_HUD: 4.0})
    streams.connected()
    return streams


def test_defaults_are_asked_for_one_at_a_time(streams):
    assert streams.poll(0) == (ATTITUDE, 100_000)
    assert streams.poll(0) is None
    streams.acknowledged(True)
    assert streams.poll(0) == (VFR_HUD, 250_000)
    streams.acknowledged(True)
    assert streams.poll(0) is None
    assert streams.deadline_ns() is None


def test_nothing_is_asked_before_the_autopilot_is_there():
    streams = StreamArbiter({ATTITUDE: 10.0})
    assert streams.poll(0) is None
    streams.client_frame(data_stream(10, 50), ALICE)
    assert streams.poll(0) is None
    streams.connected()
    assert drain(streams)[ATTITUDE] == 20_000


def test_request_is_repeated_until_answered_and_never_lost(streams):
    first = streams.poll(0)
    now_ns, sent = 0, 1
    while sent < MAX_TRIES:
        assert streams.poll(streams.deadline_ns() - 1) is None
        now_ns = streams.deadline_ns()
        assert streams.poll(now_ns) == first
        sent += 1
    # Still no answer: the others first, then this one again.
    assert streams.poll(streams.deadline_ns()) == (VFR_HUD, 250_000)
    assert streams.counters.postponed == 1
    streams.acknowledged(True)
    assert streams.poll(100 * S) == first


def test_faster_request_of_a_client_passes_as_it_is(streams):
    drain(streams)
    frame = set_interval(ATTITUDE, 20_000)
    assert streams.client_frame(frame, ALICE) == frame.raw
    assert streams.interval_us(ATTITUDE) == 20_000
    assert drain(streams) == {}


@pytest.mark.parametrize("interval_us", [1_000_000, -1, 0])
def test_slower_request_keeps_the_faster_rate_but_gets_the_autopilots_answer(streams, interval_us):
    drain(streams)
    frame = set_interval(ATTITUDE, interval_us)
    message = decoded(streams.client_frame(frame, ALICE))
    assert (message.param1, message.param2) == (ATTITUDE, 100_000)
    assert (message.get_srcSystem(), message.get_srcComponent()) == (255, 190)
    assert streams.counters.rewritten == 1


def test_a_rate_that_the_autopilot_refuses_stays_with_nobody(streams):
    """ArduCopter denies 1.5 ms (SCHED_LOOP_RATE): the requests of all who share the message went out as that."""
    drain(streams)
    for msg_id, own_us in ((ATTITUDE, 100_000), (RAW_IMU, 0)):
        frame = set_interval(msg_id, 1500)
        assert streams.client_frame(frame, ALICE) == frame.raw
        streams.denied(streams.wish(frame))
        assert streams.interval_us(msg_id) == own_us
        assert drain(streams) == ({msg_id: own_us} if own_us else {})
        other = set_interval(msg_id, 50_000)
        assert streams.client_frame(other, BOB) == other.raw


def test_a_rate_that_another_was_asked_with_is_forgotten_when_it_is_refused(streams):
    drain(streams)
    streams.client_frame(set_interval(RAW_IMU, 1500), ALICE)
    frame = set_interval(RAW_IMU, 50_000)
    assert decoded(streams.client_frame(frame, BOB)).param2 == 1500.0
    streams.denied(streams.wish(frame))
    assert drain(streams) == {RAW_IMU: 50_000}


def test_a_data_stream_that_is_too_fast_leaves_the_others_theirs(streams):
    drain(streams)
    streams.client_frame(data_stream(10, 1000), ALICE)
    assert streams.poll(0) == (ATTITUDE, 1000)
    streams.acknowledged(False)
    assert drain(streams)[ATTITUDE] == 100_000
    assert ATTITUDE not in streams.refused


def test_command_int_counts_as_well(streams):
    message = mavlink.MAVLink_command_int_message(1, 1, 0, 511, 0, 0, ATTITUDE, 1e6, 0, 0, 0, 0, 0)
    passed = decoded(streams.client_frame(client_frame(message), ALICE))
    assert (passed.get_type(), passed.param2) == ("COMMAND_INT", 100_000)


def test_fastest_client_wins_whatever_the_order(streams):
    drain(streams)
    streams.client_frame(set_interval(RAW_IMU, 10_000), ALICE)
    slower = decoded(streams.client_frame(set_interval(RAW_IMU, 50_000), BOB))
    assert slower.param2 == 10_000
    assert streams.interval_us(RAW_IMU) == 10_000


def test_wishes_of_a_client_go_with_it(streams):
    drain(streams)
    streams.client_frame(set_interval(RAW_IMU, 10_000), ALICE)
    streams.client_frame(set_interval(RAW_IMU, 50_000), BOB)
    streams.client_frame(set_interval(ATTITUDE, 20_000), ALICE)
    streams.client_left(ALICE)
    assert drain(streams) == {RAW_IMU: 50_000, ATTITUDE: 100_000}
    streams.client_left(BOB)
    assert drain(streams) == {RAW_IMU: 0}


def test_withdrawn_wish_slows_down_to_the_next_fastest(streams):
    drain(streams)
    streams.client_frame(set_interval(RAW_IMU, 10_000), ALICE)
    streams.client_frame(set_interval(RAW_IMU, 50_000), BOB)
    assert decoded(streams.client_frame(set_interval(RAW_IMU, 0), ALICE)).param2 == 50_000


def test_a_message_that_nobody_else_wants_can_be_switched_off(streams):
    frame = set_interval(RAW_IMU, -1)
    assert streams.client_frame(frame, ALICE) == frame.raw
    assert streams.interval_us(RAW_IMU) == -1


def test_data_stream_becomes_wishes_and_is_not_passed_on(streams):
    drain(streams)
    assert streams.client_frame(data_stream(10, 25), ALICE) is None
    told = drain(streams)
    assert told == dict.fromkeys(STREAM_GROUPS[10], 40_000)
    assert streams.counters.absorbed == 1


def test_slow_data_stream_does_not_slow_the_defaults(streams):
    drain(streams)
    assert streams.client_frame(data_stream(0, 1), ALICE) is None
    told = drain(streams)
    assert ATTITUDE not in told
    assert VFR_HUD not in told
    assert told[RAW_IMU] == 1_000_000


def test_stopped_data_stream_switches_off_what_nobody_wants(streams):
    drain(streams)
    streams.client_frame(data_stream(1, 10), ALICE)
    drain(streams)
    streams.client_frame(data_stream(1, 10, start=0), ALICE)
    assert drain(streams)[RAW_IMU] == -1


def test_all_wishes_are_asked_for_anew_after_a_reconnect(streams):
    drain(streams)
    streams.client_frame(set_interval(RAW_IMU, 10_000), ALICE)
    streams.client_frame(set_interval(ATTITUDE, 20_000), BOB)
    streams.disconnected()
    assert streams.poll(0) is None
    streams.connected()
    assert drain(streams) == {ATTITUDE: 20_000, VFR_HUD: 250_000, RAW_IMU: 10_000}


def test_refused_message_is_not_asked_for_again_until_the_next_connection(streams):
    drain(streams, accepted=False)
    assert streams.refused == {ATTITUDE, VFR_HUD}
    streams.client_frame(data_stream(10, 50), ALICE)
    assert ATTITUDE not in drain(streams)
    streams.connected()
    assert drain(streams)[ATTITUDE] == 20_000


def test_signed_request_passes_and_is_set_right_afterwards(streams):
    drain(streams)
    frame = set_interval(ATTITUDE, 1_000_000, signed=True)
    assert streams.client_frame(frame, ALICE) == frame.raw
    assert drain(streams) == {ATTITUDE: 100_000}


INT32 = 2.0**31
HEARTBEAT, MESSAGE_INTERVAL, AVAILABLE_MODES = 0, 244, 435


@pytest.mark.parametrize(
    ("msg_id", "interval_us"),
    [
        *[(wrong, 1e5) for wrong in (math.nan, math.inf, -3, 2.0**24, 1e38)],
        *[(HEARTBEAT, wrong) for wrong in (math.nan, math.inf, -math.inf, 1e38, INT32, -INT32, -7, 1, 999)],
    ],
)
def test_a_senseless_request_is_not_passed_on(streams, msg_id, interval_us):
    assert streams.client_frame(set_interval(msg_id, interval_us), ALICE) is None
    assert streams.counters.malformed == 1
    assert streams.interval_us(HEARTBEAT) == 0


@pytest.mark.parametrize("interval_us", [-1, 0, 1000, INT32 - 128])
def test_the_bounds_of_what_makes_sense_are_passed_on(streams, interval_us):
    frame = set_interval(RAW_IMU, interval_us)
    assert streams.client_frame(frame, ALICE) == frame.raw
    assert streams.counters.malformed == 0


def command(number, *params):
    padded = [*params, *[0.0] * (7 - len(params))]
    return client_frame(mavlink.MAVLink_command_long_message(1, 1, number, 0, *padded))


@pytest.mark.parametrize("number", [510, 511, 512])
@pytest.mark.parametrize("place", range(7))
@pytest.mark.parametrize("wrong", [1e38, math.inf, -INT32])
def test_no_number_of_a_command_about_messages_is_beyond_an_integer(streams, number, place, wrong):
    params = [float(RAW_IMU), 1e5, 0.0, 0.0, 0.0, 0.0, 0.0]
    assert streams.client_frame(command(number, *params), ALICE) is not None
    params[place] = wrong
    assert streams.client_frame(command(number, *params), ALICE) is None
    assert streams.counters.malformed == 1


def test_what_is_not_given_is_nan_but_where_it_has_to_be_given(streams):
    nothing = [math.nan] * 6
    for number in (510, 512):
        assert streams.client_frame(command(number, math.nan), ALICE) is None
        frame = command(number, ATTITUDE, *nothing)
        assert streams.client_frame(frame, ALICE) == frame.raw
    for indexed in (MESSAGE_INTERVAL, AVAILABLE_MODES):
        assert streams.client_frame(command(512, indexed, *nothing), ALICE) is None
        assert streams.client_frame(command(512, indexed, ATTITUDE, *nothing[1:]), ALICE) is not None


def test_a_data_stream_that_no_autopilot_can_send_is_no_wish(streams):
    drain(streams)
    assert streams.client_frame(data_stream(10, 65_535), ALICE) is None
    assert streams.counters.malformed == 1
    assert (streams.interval_us(ATTITUDE), drain(streams)) == (100_000, {})


def test_other_commands_pass_untouched(streams):
    frame = client_frame(mavlink.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0))
    assert streams.client_frame(frame, ALICE) == frame.raw
    assert streams.counters.client_requests == 0


def test_unknown_stream_is_counted(streams):
    assert streams.client_frame(data_stream(99, 4), ALICE) is None
    assert streams.counters.malformed == 1


@pytest.mark.parametrize("rate_hz", [0.0, -1.0, 1001.0, math.nan])
def test_default_rates_are_checked(rate_hz):
    with pytest.raises(ValueError, match=r"message 30 must be in \(0, 1000\] Hz"):
        StreamArbiter({ATTITUDE: rate_hz})


def memory(streams):
    """How many things it remembers."""
    wishes = sum(len(wishes) for wishes in streams._wishes.values())
    return wishes + len(streams._asked) + len(streams._queue) + len(streams.refused)


@pytest.mark.parametrize("interval_us", [10_000, 0, -1])
def test_wishes_for_ever_new_messages_are_bounded_and_counted(streams, interval_us):
    drain(streams)
    passed = sum(
        streams.client_frame(set_interval(msg_id, interval_us), ALICE) is not None
        for msg_id in range(1000, 1000 + 3 * MAX_WISHES)
    )
    assert memory(streams) <= 2 * MAX_WISHES + 2
    if interval_us:
        assert (passed, streams.counters.too_many) == (MAX_WISHES, 2 * MAX_WISHES)
        assert streams.client_frame(set_interval(1000, 50_000), ALICE) is not None  # one that it has


def test_clients_that_come_and_go_leave_nothing_behind(streams):
    drain(streams)
    empty = memory(streams)
    for link in range(1, 40):
        for msg_id in range(1000 * link, 1000 * link + 20):
            streams.client_frame(set_interval(msg_id, 10_000), link)
        streams.client_left(link)
        if link % 2:
            drain(streams, accepted=False)
        if link % 10 == 0:
            streams.disconnected()
            streams.client_frame(set_interval(1000 * link, 10_000), link)
            streams.client_left(link)
            streams.connected()
    drain(streams)
    assert memory(streams) <= empty


def test_reset_that_nobody_answers_is_not_lost(streams):
    drain(streams)
    streams.client_frame(data_stream(3, 10), ALICE)
    drain(streams)
    streams.client_left(ALICE)
    now_ns, asked = 0, []
    for _ in range(3 * 3 * MAX_TRIES):
        request = streams.poll(now_ns)
        if request is not None:
            asked.append(request)
        now_ns = streams.deadline_ns()
    assert {asked.count((msg_id, 0)) >= 2 * MAX_TRIES for msg_id in STREAM_GROUPS[3]} == {True}
