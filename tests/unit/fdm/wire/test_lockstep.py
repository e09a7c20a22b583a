import pytest

from fdm.wire.lockstep import RESEND_SILENCE_NS, FrameTimer, Lockstep, ServoVerdict

A, B = ("127.0.0.1", 40000), ("127.0.0.1", 40001)


def after(*counts, answered=True):
    """A lockstep that took frames `counts` from sender A and answered all, or all but the last."""
    lockstep = Lockstep()
    for index, count in enumerate(counts):
        lockstep.receive(count, A, 0)
        if answered or index < len(counts) - 1:
            lockstep.answered(count, b"reply", 0)
    return lockstep


@pytest.mark.parametrize("first", [0, 1, 12345])
def test_the_first_packet_boots(first):
    assert Lockstep().receive(first, A, 0) is ServoVerdict.BOOT


def test_frames_advance_and_the_count_wraps():
    assert after(0).receive(1, A, 0) is ServoVerdict.ADVANCE
    assert after(2**32 - 1).receive(0, A, 0) is ServoVerdict.ADVANCE


def test_a_jump_forward_is_a_gap():
    lockstep = after(5)
    assert lockstep.receive(9, A, 0) is ServoVerdict.GAP
    assert lockstep.waiting
    lockstep.answered(9, b"", 0)
    assert lockstep.receive(10, A, 0) is ServoVerdict.ADVANCE


def test_a_repeat_of_a_frame_that_waits_is_nothing():
    assert after(3, answered=False).receive(3, A, 5 * RESEND_SILENCE_NS) is ServoVerdict.WAITING


def test_an_answered_frame_is_answered_again_only_after_silence():
    lockstep = after(3)
    assert lockstep.receive(3, A, RESEND_SILENCE_NS - 1) is ServoVerdict.DUPLICATE
    assert lockstep.receive(3, A, RESEND_SILENCE_NS) is ServoVerdict.RESEND
    assert lockstep.receive(3, A, RESEND_SILENCE_NS + 1) is ServoVerdict.DUPLICATE
    assert lockstep.reply == b"reply"


def test_each_new_packet_shows_that_one_answer_was_read():
    lockstep = after(0)
    lockstep.answered_beforehand(0)
    assert lockstep.unread == 2
    for count, unread in ((1, 1), (1, 1), (2, 0), (3, 0)):
        lockstep.receive(count, A, 1)
        assert lockstep.unread == unread
    lockstep.answered(1, b"", 1)
    lockstep.answered(2, b"", 1)
    lockstep.receive(6, A, 2)
    assert lockstep.unread == 0
    lockstep.answered(6, b"", 2)
    lockstep.receive(0, B, 3)
    assert lockstep.unread == 0


def test_who_asks_again_after_silence_has_read_all_that_arrived():
    lockstep = after(0)
    lockstep.answered_beforehand(0)
    lockstep.receive(1, A, 1)
    lockstep.receive(1, A, RESEND_SILENCE_NS - 1)
    assert lockstep.unread == 1  # it may have asked before the answer came
    assert lockstep.receive(1, A, RESEND_SILENCE_NS) is ServoVerdict.WAITING
    assert lockstep.unread == 0


def test_a_late_datagram_is_no_restart():
    assert after(1).receive(0, A, 0) is ServoVerdict.STALE
    lockstep = after(100)
    assert lockstep.receive(98, A, 0) is ServoVerdict.STALE
    assert lockstep.receive(101, A, 0) is ServoVerdict.ADVANCE


def test_more_than_65536_frames_are_no_restart():
    assert after(65535).receive(65536, A, 0) is ServoVerdict.ADVANCE


@pytest.mark.parametrize(
    ("last", "count", "sender"),
    [
        (100, 0, A),
        (100, 50, A),
        (5, 0, A),
        (5, 3, B),
        (0, 0, B),
        (2**31 + 1, 0, B),
        (2**32 - 2, 0, A),
    ],
)
def test_a_drop_of_the_count_is_a_restart(last, count, sender):
    lockstep = after(last)
    assert lockstep.receive(count, sender, 0) is ServoVerdict.RESTART
    assert lockstep.sender == sender


def test_replies_go_to_the_last_sender():
    lockstep = after(5)
    assert lockstep.receive(6, B, 0) is ServoVerdict.ADVANCE
    assert lockstep.sender == B


def test_time_is_exact_after_a_day_of_frames():
    timer = FrameTimer()
    timer.advance(1200)
    timer._frames = 1200 * 86_400 - 1
    assert timer.advance(1200) == 86_400 * 10**9


def test_a_change_of_rate_goes_on_from_the_present_time():
    timer = FrameTimer()
    for _ in range(3):
        timer.advance(1200)
    assert timer.time_ns == 2_500_000
    assert timer.next_ns(400) == 5_000_000
    assert timer.time_ns == 2_500_000
    assert timer.advance(400) == 5_000_000
    assert timer.advance(400) == 7_500_000


HOUR_NS = 3600 * 10**9


def test_of_two_autopilots_on_one_port_the_later_one_is_heard_however_slowly_it_is_answered():
    """A is far ahead when B boots, and goes on sending: packets, and repeats of these, until it boots itself."""
    lockstep = after(1000)
    assert lockstep.receive(0, B, 1) is ServoVerdict.RESTART
    for count in (1001, 1001, 1002):
        assert lockstep.receive(count, A, HOUR_NS) is ServoVerdict.REPLACED
    for count in range(60):
        lockstep.answered(count, b"", HOUR_NS)
        assert lockstep.receive(count + 1, B, HOUR_NS) is ServoVerdict.ADVANCE
    assert lockstep.receive(1002, A, 2 * HOUR_NS) is ServoVerdict.REPLACED
    assert lockstep.sender == B
    assert lockstep.receive(0, A, 2 * HOUR_NS) is ServoVerdict.RESTART
    assert lockstep.receive(61, B, 2 * HOUR_NS) is ServoVerdict.REPLACED


def test_of_two_that_boot_together_the_earlier_one_does_not_come_back_with_its_first_packet():
    lockstep = Lockstep()
    assert lockstep.receive(0, A, 0) is ServoVerdict.BOOT
    assert lockstep.receive(0, B, 1) is ServoVerdict.RESTART
    for count in range(60):
        lockstep.answered(count, b"", HOUR_NS)
        assert lockstep.receive(0, A, 2 * HOUR_NS) is ServoVerdict.REPLACED
        assert lockstep.receive(count + 1, B, 2 * HOUR_NS) is ServoVerdict.ADVANCE


def test_the_later_one_is_heard_also_when_it_boots_anew_at_other_ports():
    """Real ArduCopter, started once more within seconds, was told nothing any more, and the one of before flew on."""
    lockstep = after(1000)
    for port in range(40001, 40005):
        now = ("127.0.0.1", port)
        assert lockstep.receive(0, now, 1) is ServoVerdict.RESTART
        lockstep.answered(0, b"", 1)
        assert lockstep.receive(1001, A, 2) is ServoVerdict.REPLACED
        assert lockstep.receive(1, now, 2) is ServoVerdict.ADVANCE
        lockstep.answered(1, b"", 2)


def test_an_autopilot_that_boots_anew_at_another_port_is_heard():
    """Each time: none of these ports was that of the one before."""
    lockstep = after(100)
    for port in range(40001, 40005):
        assert lockstep.receive(0, ("127.0.0.1", port), 1) is ServoVerdict.RESTART
