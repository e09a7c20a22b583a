import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from aps.autopilot_link import AutopilotAddress, parse_autopilot, parse_host_port
from aps.framer import Framer
from aps.outbox import Outbox
from aps.status_text import StatusText, StatusTextAssembler
from aps.subscription import Subscription
from aps.telemetry import AircraftState


class Transport:
    def __init__(self):
        self.written = []

    def set_write_buffer_limits(self, high):
        self.high = high

    def get_extra_info(self, name):
        return None

    def write(self, data):
        self.written.append(data)


def status_text(text, text_id=0, chunk=0, severity=3):
    mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    (frame,) = Framer().receive(
        bytes(mavlink.MAVLink_statustext_message(severity, text, text_id, chunk).pack(mav))
    )
    return frame


def test_short_text():
    assert StatusTextAssembler().take(status_text(b"PreArm: no GPS")) == StatusText(3, "PreArm: no GPS")


def test_chunked_text_is_joined():
    assembler = StatusTextAssembler()
    assert assembler.take(status_text(b"a" * 50, 7, 0)) is None
    assert assembler.take(status_text(b"b" * 50, 7, 1)) is None
    assert assembler.take(status_text(b"end", 7, 2)).text == "a" * 50 + "b" * 50 + "end"


def test_text_with_a_lost_end_does_not_leak_into_the_next():
    assembler = StatusTextAssembler()
    assembler.take(status_text(b"a" * 50, 7, 0))
    assert assembler.take(status_text(b"next", 8, 0)).text == "next"


def test_undecodable_text():
    assert StatusTextAssembler().take(status_text(b"\xff\xfe")).text == "\N{REPLACEMENT CHARACTER}" * 2


def test_outbox_joins_frames_into_one_write():
    outbox, transport = Outbox(), Transport()
    outbox.open(transport)
    for frame in (b"one", b"two"):
        outbox.put(frame)
    assert transport.written == []
    outbox.flush()
    assert transport.written == [b"onetwo"]
    assert (outbox.counters.written_frames, outbox.counters.written_bytes) == (2, 6)


def test_full_outbox_drops_the_oldest_and_counts_them():
    outbox, transport = Outbox(1024), Transport()
    outbox.open(transport)
    outbox.pause()
    frames = [bytes([number]) * 100 for number in range(30)]
    for frame in frames:
        outbox.put(frame)
        outbox.flush()
    assert transport.written == []
    outbox.resume()
    assert transport.written == [b"".join(frames[-10:])]
    counters = outbox.counters
    assert (counters.queued_frames, counters.written_frames, counters.dropped_full) == (30, 10, 20)


def test_closed_outbox_counts_what_it_cannot_send():
    outbox = Outbox()
    outbox.put(b"nobody there")
    outbox.open(Transport())
    outbox.put(b"waiting")
    outbox.close()
    outbox.flush()
    assert (outbox.counters.dropped_closed, outbox.waiting_frames) == (2, 0)


def test_outbox_limit_is_checked():
    with pytest.raises(ValueError, match="at least 1024 bytes, not 10"):
        Outbox(10)


def offered(period_ms, times_ms):
    got = []
    subscription = Subscription(lambda state: got.append(state.time_boot_ms), period_ms, lambda _: None)
    for ms in times_ms:
        subscription.offer(AircraftState(sysid=1, time_boot_ms=ms))
    return got


def test_subscription_keeps_its_rate_in_the_autopilots_time():
    assert len(offered(100.0, range(0, 10_000, 30))) == 100
    assert offered(0.0, [1, 2, 2, 3]) == [1, 2, 2, 3]


def test_subscription_goes_on_after_a_gap_and_after_a_reboot():
    assert offered(100.0, [0, 5000, 5010, 5200, 90, 150, 200]) == [0, 5000, 5200, 90, 200]


def test_failing_callback_does_not_reach_the_caller(caplog):
    def fail(_state):
        raise RuntimeError("mine")

    Subscription(fail, 0.0, lambda _: None).offer(AircraftState(sysid=1))
    assert "a state callback failed" in caplog.text


def test_addresses():
    assert parse_autopilot("tcp:127.0.0.1:5760") == AutopilotAddress("127.0.0.1", 5760)
    assert str(parse_autopilot("tcp:host:1")) == "tcp:host:1"
    assert parse_host_port("[::1]:80") == ("::1", 80)
    assert parse_host_port("0.0.0.0:0", lowest_port=0) == ("0.0.0.0", 0)


@pytest.mark.parametrize(
    "text", ["127.0.0.1:5760", "tcp:5760", "tcp::5760", "tcp:h:0", "tcp:h:65536", "tcp:h:x"]
)
def test_bad_addresses(text):
    with pytest.raises(ValueError, match="is not"):
        parse_autopilot(text)
