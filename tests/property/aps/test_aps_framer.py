import itertools
import math
from dataclasses import fields, replace

from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from aps.config import DaemonConfig
from aps.core import Core
from aps.links.link import Link, Opening, Role
from aps.vehicle.streams import StreamArbiter
from aps.vehicle.telemetry import _DECODERS, Telemetry
from aps.wire.framer import MAX_FRAME_BYTES, Framer

ALL_MESSAGES = tuple(sorted(mavlink.mavlink_map))


def _value(kind, length, wild):
    if kind == "char":
        return st.binary(max_size=length)
    if kind in ("float", "double"):
        one = st.floats(width=32, allow_nan=wild, allow_infinity=wild)
    else:
        bits = int(
            "".join(c for c in kind.removesuffix("_t").removesuffix("_mavlink_version") if c.isdigit())
        )
        signed = kind.startswith("int")
        one = st.integers(-(1 << bits - 1) if signed else 0, (1 << bits - signed) - 1)
    return st.lists(one, min_size=length, max_size=length) if length > 1 else one


@st.composite
def messages(draw, msg_ids=ALL_MESSAGES, wild=False, sender=None):
    """A random message of the dialect with random values, packed as v1 or v2, maybe signed.

    ``wild`` values are also NaN and infinite.
    """
    cls = mavlink.mavlink_map[draw(st.sampled_from(msg_ids))]
    lengths = dict(zip(cls.ordered_fieldnames, cls.array_lengths, strict=True))
    values = [
        draw(_value(kind, max(1, lengths[name]), wild))
        for name, kind in zip(cls.fieldnames, cls.fieldtypes, strict=True)
    ]
    sysid, compid = sender or draw(st.tuples(st.integers(1, 255), st.integers(0, 255)))
    mav = mavlink.MAVLink(None, srcSystem=sysid, srcComponent=compid)
    mav.seq = draw(st.integers(0, 255))
    kind = draw(st.sampled_from(["v1", "v2", "signed"]))
    if kind == "signed":
        mav.signing.secret_key, mav.signing.sign_outgoing = b"x" * 32, True
    return bytes(cls(*values).pack(mav, force_mavlink1=kind == "v1" and cls.id < 256))


def chunked(data, cuts):
    edges = [0, *sorted(cut % (len(data) + 1) for cut in cuts), len(data)]
    return [data[start:end] for start, end in itertools.pairwise(edges)]


def frames_of(chunks):
    framer = Framer()
    return [frame for chunk in chunks for frame in framer.receive(chunk)], framer


@given(st.lists(messages(), min_size=1, max_size=8), st.lists(st.integers(0, 10_000), max_size=12))
def test_any_message_in_any_chunking_comes_out_unchanged(raws, cuts):
    frames, framer = frames_of(chunked(b"".join(raws), cuts))
    assert [frame.raw for frame in frames] == raws
    assert framer.counters.skipped_bytes == framer.counters.bad_crc == framer.pending_bytes == 0


@given(st.lists(messages(), min_size=1, max_size=5))
def test_header_agrees_with_pymavlink(raws):
    parser = mavlink.MAVLink(None)
    parser.robust_parsing = True
    frames, _ = frames_of([b"".join(raws)])
    for raw, frame in zip(raws, frames, strict=True):
        (message,) = parser.parse_buffer(raw)
        assert frame.msg_id == message.get_msgId()
        assert (frame.sysid, frame.compid) == (message.get_srcSystem(), message.get_srcComponent())
        assert frame.seq == message.get_seq()
        target = (
            message.target if message.get_type() == "MANUAL_CONTROL" else getattr(message, "target_system", 0)
        )
        assert frame.target_system == target
        assert frame.target_component == (
            getattr(message, "target_component", 0) if hasattr(message, "target_system") else 0
        )


@given(
    st.lists(st.one_of(messages(), st.binary(max_size=60)), max_size=8),
    st.lists(st.integers(0, 10_000), max_size=12),
)
def test_chunking_does_not_matter_with_garbage_in_between(pieces, cuts):
    data = b"".join(pieces)
    whole, one = frames_of([data])
    parts, many = frames_of(chunked(data, cuts))
    assert parts == whole
    assert many.counters == one.counters


@given(st.lists(st.binary(max_size=600), max_size=6))
def test_arbitrary_bytes_never_raise_and_every_byte_is_accounted_for(chunks):
    frames, framer = frames_of(chunks)
    used = sum(len(frame.raw) for frame in frames)
    assert used + framer.counters.skipped_bytes + framer.pending_bytes == sum(map(len, chunks))
    assert framer.pending_bytes <= MAX_FRAME_BYTES


@given(messages(), st.lists(st.tuples(st.integers(0, 400), st.integers(1, 255)), min_size=1, max_size=4))
def test_mutated_stream_finds_its_way_back(raw, mutations):
    bad = bytearray(raw)
    for at, flip in mutations:
        bad[at % len(bad)] ^= flip
    mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    # At worst a mutated length swallows one longest frame's worth of good ones.
    good = [bytes(mavlink.MAVLink_system_time_message(0, 1000 + n).pack(mav)) for n in range(60)]
    frames, _ = frames_of([bytes(bad) + b"".join(good)])
    swallowed = math.ceil(MAX_FRAME_BYTES / min(map(len, good))) + 1
    assert [frame.raw for frame in frames][-(60 - swallowed) :] == good[swallowed:]


def numbers(state):
    """All floats of a state, also of its vectors."""
    for value in (*(getattr(state, field.name) for field in fields(state)), state.wind_body_mps):
        for number in value if isinstance(value, tuple) else (value,):
            if isinstance(number, float):
                yield number


@given(st.lists(messages(tuple(sorted(_DECODERS)), wild=True), max_size=12))
@settings(max_examples=120)
def test_state_takes_any_values_and_is_never_infinite(raws):
    telemetry = Telemetry(1)
    for now, frame in enumerate(frames_of(raws)[0]):
        assert telemetry.update(frame, now)
    state = replace(telemetry.state(100), heartbeat_age_s=0.0)
    for lat_deg, lon_deg in ((state.lat_deg, state.lon_deg), (state.home_lat_deg, state.home_lon_deg)):
        assert math.isnan(lat_deg) or abs(lat_deg) <= 90.0
        assert math.isnan(lon_deg) or abs(lon_deg) <= 180.0
    assert state.flight_time_s >= 0.0
    assert not any(math.isinf(number) for number in numbers(state))


FROM_AUTOPILOT = messages((*sorted(_DECODERS), 22, 77, 253), wild=True, sender=(1, 1))
FROM_CLIENT = messages((0, 66, 75, 76, 109, 11, 23), wild=True)


class Bin:
    def put(self, frame):
        assert frame

    def put_all(self, frames, size_bytes):
        assert sum(map(len, frames)) == size_bytes > 0


@given(
    st.lists(st.tuples(st.booleans(), st.integers(0, 40_000_000_000)), max_size=25),
    st.lists(FROM_AUTOPILOT, min_size=1, max_size=12),
    st.lists(FROM_CLIENT, min_size=1, max_size=12),
    st.sampled_from([("arm",), ("takeoff", 10.0), ("goto", 47.0, 8.0, 20.0), ("rtl",), ("land",)]),
)
def test_the_logic_takes_any_messages_at_any_time(turns, said, sent, command):
    now_ns, ends = 0, []
    config = DaemonConfig(autopilot="tcp:127.0.0.1:1", sysid=1)
    core = Core(config, lambda: now_ns, lambda: None)
    link, client = Link("autopilot", Bin(), Opening(Role.AUTOPILOT)), Link("client", Bin())
    client.id = 1
    core.link_opened(link, 0)
    core.link_opened(client, 0)
    heartbeat = mavlink.MAVLink_heartbeat_message(2, 3, 0xD9, 4, 4, 3)
    raw = bytes(heartbeat.pack(mavlink.MAVLink(None, srcSystem=1, srcComponent=1)))
    core.frames(link, link.framer.receive(raw), 0)
    core.vehicle.subscriptions.add(lambda state: None, rate_hz=5.0)
    core.vehicle.commands.start(*command, on_done=ends.append)
    from_autopilot, from_client = itertools.cycle(said), itertools.cycle(frames_of(sent)[0])
    for autopilot, wait_ns in turns:
        now_ns += wait_ns
        if autopilot:
            core.frames(link, link.framer.receive(next(from_autopilot)), now_ns)
        else:
            core.frames(client, [next(from_client)], now_ns)
        core.on_time(now_ns)
    core.vehicle.commands.interrupt_all("the end")
    assert len(ends) == 1
    assert core.vehicle.callbacks.errors == 0


@given(st.lists(messages(), max_size=6))
def test_stream_arbiter_takes_any_frame(raws):
    streams = StreamArbiter()
    for link, frame in enumerate(frames_of(raws)[0]):
        passed = streams.client_frame(frame, link)
        assert passed is None or len(Framer().receive(passed)) == 1
