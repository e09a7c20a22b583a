from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from fdm.exchange.px4.frames import FramesOfPx4
from fdm.wire.px4 import hil
from fdm.wire.px4.mavlink import FrameReader, FrameWriter

ANSWERS = st.builds(
    hil.ActuatorControls,
    st.integers(0, 2**64 - 1),
    st.tuples(*[st.floats(-2, 2, width=32)] * 16),
    st.booleans(),
    st.booleans(),
)


def cut(data, cuts):
    places = sorted({0, len(data), *(place % (len(data) + 1) for place in cuts)})
    return [data[begin:end] for begin, end in pairwise(places)]


@given(st.lists(ANSWERS, max_size=5), st.lists(st.integers(0), max_size=20))
def test_any_chunking_yields_the_same_answers(answers, cuts):
    writer, reader = FrameWriter(1, 1), FrameReader(hil.FROM_PX4)
    data = b"".join(hil.actuators_frame(writer, answer) for answer in answers)
    found = [payload for chunk in cut(data, cuts) for _, payload in reader.feed(chunk)]
    assert [hil.read_actuators(payload) for payload in found] == answers
    assert not reader.counters


@given(st.lists(st.binary(max_size=400) | st.just(b"\xfd\x09") | st.just(b"\xfe\xff"), max_size=8))
def test_arbitrary_bytes_never_raise_and_are_not_kept_for_ever(chunks):
    frames = FramesOfPx4(250, frozenset({1}))
    frames.sent(1, 0)
    for chunk in chunks:
        frames.receive(chunk)
    assert len(frames.done()) == 19


@given(st.binary(max_size=300), ANSWERS)
def test_an_answer_behind_noise_is_found_once_the_noise_has_passed(noise, answer):
    reader = FrameReader(hil.FROM_PX4)
    frame = hil.actuators_frame(FrameWriter(1, 1), answer)
    found = reader.feed(noise.replace(b"\xfd", b"").replace(b"\xfe", b"") + frame)
    assert [hil.read_actuators(payload) for _, payload in found] == [answer]
