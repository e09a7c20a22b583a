import pytest

from fdm.exchange.px4.frames import PATIENCE_NS, FramesOfPx4
from fdm.wire.px4.hil import ActuatorControls, actuators_frame
from fdm.wire.px4.mavlink import FrameWriter
from tests.px4_recording import records

MOTORS = frozenset({1, 2, 3, 4})


@pytest.fixture
def frames():
    return FramesOfPx4(250, MOTORS)


def answer(frame, *controls, is_lockstep=True):
    padded = controls + (0.0,) * (16 - len(controls))
    return actuators_frame(FrameWriter(1, 1), ActuatorControls(frame * 4000, padded, True, is_lockstep))


def test_the_first_packet_asks_for_the_first_frame_with_idle_motors(frames):
    assert frames.hello() == (0, 250, 0, 1000, 1000, 1000, 1000, *(1500,) * 12)


def test_an_answered_frame_drives_the_motors(frames):
    frames.sent(1, 0)
    assert not frames.answered
    frames.receive(answer(1, 0.1, 0.2, 0.3, 0.4, -0.5))
    assert frames.answered
    assert frames.done() == (0, 250, 1, 1100, 1200, 1300, 1400, 1250, *(1500,) * 11)
    assert not frames.awaits


def test_a_frame_without_an_answer_keeps_the_outputs_and_is_counted(frames):
    frames.sent(1, 0)
    frames.receive(answer(1, 0.1))
    frames.done()
    frames.sent(2, 0)
    assert frames.done()[2:4] == (2, 1100)
    assert frames.counters == {"frames_unanswered": 1}


def test_answers_to_other_frames_and_second_ones_are_not_taken(frames):
    frames.sent(2, 0)
    frames.receive(answer(1, 0.9) + answer(2, 0.2) + answer(2, 0.7))
    assert frames.done()[3] == 1200
    assert frames.counters == {"answers_not_asked_for": 2}


def test_where_rest_cannot_be_seen_an_answer_or_patience_ends_a_frame():
    frames = FramesOfPx4(250, MOTORS, sees_rest=False)
    assert not frames.is_done(0)
    frames.sent(1, 1000)
    assert not frames.is_done(1000 + PATIENCE_NS - 1)
    assert frames.is_done(1000 + PATIENCE_NS)
    frames.receive(answer(1))
    assert frames.is_done(1001)


def test_where_rest_cannot_be_seen_there_is_no_patience_after_the_first_answer():
    frames = FramesOfPx4(250, MOTORS, sees_rest=False)
    frames.sent(1, 0)
    frames.receive(answer(1))
    frames.done()
    frames.sent(2, 0)
    assert not frames.is_done(1000 * PATIENCE_NS)
    frames.receive(answer(2))
    assert frames.is_done(1000 * PATIENCE_NS)


def test_answers_out_of_lockstep_are_not_taken(frames):
    assert frames.is_lockstep
    frames.sent(1, 0)
    frames.receive(answer(1, 0.9, is_lockstep=False))
    assert not frames.answered
    assert not frames.is_lockstep
    assert frames.counters == {"answers_not_in_lockstep": 1}


def test_silence_is_told_once_for_each_time_it_lasts_four_seconds(frames):
    told = []
    for frame in range(1, 3001):
        frames.sent(frame, 0)
        if frame == 1500:
            frames.receive(answer(frame))
        frames.done()
        if frames.falls_silent:
            told.append(frame)
    assert told == [1000, 2500]  # 250 Hz


def test_what_was_dropped_of_the_stream_is_in_the_totals(frames):
    frames.sent(1, 0)
    frames.receive(b"noise" + answer(1)[:-1] + b"?" + answer(2))
    frames.done()
    totals = frames.totals()
    assert (totals["bad_checksum"], totals["answers_not_asked_for"], totals["frames_unanswered"]) == (1, 1, 1)
    assert totals["noise_bytes"] >= 5


def test_what_a_real_px4_answered_drives_the_motors_frame_by_frame(frames):
    """As recorded: frames 1 to 8 find no module that answers, the last ones are those of a take-off."""
    number, packets = 0, []
    for from_px4, data in records():
        if from_px4:
            frames.receive(data)
            continue
        if number:
            packets.append(frames.done())
        number += 1
        frames.sent(number if number <= 40 else 2400 + number - 41, 0)
    assert [packet[2] for packet in packets[:40]] == list(range(1, 41))
    assert frames.counters["frames_unanswered"] == 8
    assert set(packets[30][3:7]) == {1000}
    assert all(1000 < pulse < 1500 for pulse in packets[-1][3:7])
