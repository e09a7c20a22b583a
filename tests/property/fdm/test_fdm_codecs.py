from hypothesis import given
from hypothesis import strategies as st

from fdm.wire.lockstep import STEPPING, Lockstep
from fdm.wire.sensor_frame import decode_sensor_frame, make_encoder
from fdm.wire.servo_packet import DROP_REASONS, ServoPacket, encode_servo_packet, unpack_servo_packet

u16 = st.integers(0, 2**16 - 1)
packets = st.builds(
    ServoPacket,
    st.integers(10, 2**16 - 1),
    st.integers(0, 2**32 - 1),
    st.sampled_from([16, 32]).flatmap(lambda n: st.tuples(*[u16] * n)),
)
number = st.floats(-1e4, 1e4)
frames = st.tuples(st.floats(0, 1e6), *[number] * 16)
encode_frame = make_encoder()


@given(packets)
def test_servo_packets_round_trip(packet):
    _, *fields = unpack_servo_packet(encode_servo_packet(packet))
    assert fields == [packet.frame_rate_hz, packet.frame_count, *packet.servo_output_us]


@given(
    st.binary(max_size=128) | st.sampled_from([40, 72]).flatmap(lambda n: st.binary(min_size=n, max_size=n))
)
def test_any_bytes_are_fields_or_a_reason(datagram):
    fields = unpack_servo_packet(datagram)
    assert fields in DROP_REASONS if isinstance(fields, str) else len(fields) in (19, 35)


@given(packets, st.integers(1, 255))
def test_a_packet_with_a_broken_magic_is_refused(packet, flip):
    datagram = bytearray(encode_servo_packet(packet))
    datagram[0] ^= flip
    assert unpack_servo_packet(bytes(datagram)) == "bad_magic"


@given(frames)
def test_sensor_frames_round_trip(frame):
    back = decode_sensor_frame(encode_frame(frame))
    assert abs(back.timestamp_s - frame[0]) <= 1e-9
    vectors = back.gyro_frd_radps, back.specific_force_frd_mps2, back.position_ned_m, back.attitude_rad
    numbers = [number for vector in (*vectors, back.velocity_ned_mps) for number in vector]
    pairs = zip((*numbers, back.airspeed_eas_mps), frame[1:], strict=True)
    assert all(abs(got - sent) <= 1e-5 for got, sent in pairs)


@given(
    st.binary(max_size=400)
    | frames.map(encode_frame).flatmap(lambda good: st.integers(0, len(good)).map(lambda cut: good[:cut]))
)
def test_any_bytes_are_a_sensor_frame_or_none(datagram):
    frame = decode_sensor_frame(datagram)
    assert frame is None or frame.timestamp_s >= 0


@given(st.lists(st.tuples(st.integers(0, 20), st.sampled_from("AB"), st.integers(0, 10**9), st.booleans())))
def test_a_frame_count_is_never_stepped_twice_in_a_row_for_one_sender(steps):
    lockstep, wall_ns, last = Lockstep(), 0, None
    for count, sender, gap_ns, answer in steps:
        wall_ns += gap_ns
        verdict = lockstep.receive(count, sender, wall_ns)
        if verdict in STEPPING:
            assert (count, sender) != last
            assert lockstep.waiting
            last = (count, sender)
        if answer and last and lockstep.waiting:
            lockstep.answered(last[0], b"", wall_ns)
            assert not lockstep.waiting
