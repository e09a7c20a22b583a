"""Whatever comes over its sockets, the stand-in goes on: arbitrary bytes, messages and frames."""

import json
import struct
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from fdm.wire.sensor_frame import make_encoder, make_rounder
from standin.autopilot import Autopilot
from standin.control.mixer import QUAD_X
from standin.vehicle.location import Location
from standin.vehicle.parameters import StandinParameters
from standin.wire.mavlink_codec import MavlinkCodec
from standin.wire.sensors import parse_sensor_frame, sensed_frame

HOME = Location(45.0, 10.0, 100.0)
any_float = st.floats(allow_nan=True, allow_infinity=True, width=32)
vector = st.lists(st.floats(-1e3, 1e3), min_size=3, max_size=3)


def sensor_frame(timestamp_s: float, **changes: Any) -> bytes:
    frame: dict[str, Any] = {
        "timestamp": timestamp_s,
        "imu": {"gyro": [0.0, 0.0, 0.0], "accel_body": [0.0, 0.0, -9.8]},
        "position": [0.0, 0.0, 0.0],
        "velocity": [0.0, 0.0, 0.0],
        "quaternion": [1.0, 0.0, 0.0, 0.0],
    }
    return json.dumps(frame | changes).encode()


def turn(made: Autopilot, datagram: bytes) -> bytes | None:
    if not made.take_frame(parse_sensor_frame(datagram)):
        return None
    made.step()
    return made.fdm.packet


def say(made: Autopilot, *messages: Any) -> list[Any]:
    """Let messages take effect with a frame; return what is said then."""
    codec = dialect.MAVLink(None, 255, 190)
    made.mavlink.data_to_send()
    for message in messages:
        made.mavlink.receive(message.pack(codec))
    assert turn(made, sensor_frame(made.fdm.sim_time_ns / 1e9 + 0.01)) is not None
    return dialect.MAVLink(None).parse_buffer(made.mavlink.data_to_send()) or []


def autopilot(*, in_guided: bool = False) -> Autopilot:
    made = Autopilot(HOME, StandinParameters(), frame_rate_hz=400, boot_unix_us=0)
    made.mavlink.connect()
    for index in range(45 if in_guided else 3):
        turn(made, sensor_frame(index * 0.1))
    if in_guided:
        made.vehicle.set_mode(4)
        assert made.vehicle.arm(force=False)
    return made


def some_messages() -> list[Any]:
    return [
        dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3),
        dialect.MAVLink_param_set_message(1, 1, b"RTL_ALT", 12.0, 9),
        dialect.MAVLink_command_long_message(1, 1, 511, 0, 30, 1e5, 0, 0, 0, 0, 0),
        dialect.MAVLink_mission_count_message(1, 1, 3, 0),
    ]


@given(st.binary(max_size=600))
def test_any_datagram_is_a_frame_or_is_counted(datagram: bytes) -> None:
    made = autopilot()
    before = made.fdm.events.copy()
    answer = turn(made, datagram)
    counted = made.fdm.events - before
    assert (answer is not None) == (counted["frames"] == 1)
    assert counted["frames"] + counted["malformed"] + counted["duplicate"] == 1


@given(
    st.recursive(
        st.none() | st.booleans() | st.floats() | st.text(),
        lambda x: (
            st.lists(x)
            | st.dictionaries(
                st.sampled_from(
                    [
                        "timestamp",
                        "imu",
                        "gyro",
                        "accel_body",
                        "position",
                        "velocity",
                        "quaternion",
                        "attitude",
                    ]
                ),
                x,
            )
        ),
        max_leaves=20,
    )
)
def test_any_json_is_a_frame_or_nothing(data: Any) -> None:
    frame = parse_sensor_frame(json.dumps(data).encode())
    assert frame is None or 0.0 <= frame.timestamp_s <= 1e9


@given(st.floats(0.0, 1e5), *[st.lists(st.floats(-1e3, 1e3), min_size=3, max_size=3)] * 3)
def test_numbers_are_the_doubles_nearest_to_their_decimals(
    timestamp_s: float, gyro: list[float], force: list[float], position: list[float]
) -> None:
    values = (timestamp_s, *gyro, *force, *position, 0.1, 0.2, 0.3, *gyro, 5.0)
    datagram = make_encoder()(values)
    frame, text = parse_sensor_frame(datagram), json.loads(datagram)
    assert frame is not None
    assert frame.timestamp_s == text["timestamp"]
    for parsed, written in (
        (frame.gyro_radps, text["imu"]["gyro"]),
        (frame.specific_force_mps2, text["imu"]["accel_body"]),
        (frame.position_ned_m, text["position"]),
        (frame.velocity_ned_mps, text["velocity"]),
    ):
        assert list(parsed) == written


@given(vector, vector, vector, vector, st.lists(st.floats(-1.0, 1.0), min_size=4, max_size=4))
def test_servo_outputs_stay_in_range_for_any_motion(
    gyro: list[float], force: list[float], position: list[float], velocity: list[float], attitude: list[float]
) -> None:
    made = autopilot(in_guided=True)
    assert made.vehicle.mode.take_off(10.0)  # type: ignore[attr-defined]
    imu = {"gyro": gyro, "accel_body": force}
    for index in range(12):
        frame = sensor_frame(
            5.0 + index * 0.01, imu=imu, position=position, velocity=velocity, quaternion=attitude
        )
        packet = turn(made, frame)
        if packet is not None:
            outputs = struct.unpack("<HHI16H", packet)[3:]
            assert all(1000 <= output <= 2000 for output in outputs[:4])
            assert outputs[4:] == (0,) * 12


@given(st.binary(max_size=400), st.integers(0, 3))
def test_a_message_after_garbage_is_found_and_the_garbage_is_counted(before: bytes, which: int) -> None:
    codec = MavlinkCodec(1)
    message = some_messages()[which]
    heard = codec.receive(before + bytes(600) + message.pack(dialect.MAVLink(None, 255, 190)))
    assert heard[-1].get_type() == message.get_type()
    assert sum(codec.dropped.values()) > 0


@given(st.lists(st.integers(0, 3), max_size=6), st.data())
def test_any_chunking_gives_the_same_messages(which: list[int], data: st.DataObject) -> None:
    client = dialect.MAVLink(None, 255, 190)
    stream = b"".join(b"noise" + some_messages()[index].pack(client) for index in which)
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=8)))
    codec = MavlinkCodec(1)
    heard = []
    for start, end in zip([0, *cuts], [*cuts, len(stream)], strict=True):
        heard += codec.receive(stream[start:end])
    assert [m.get_type() for m in heard] == [some_messages()[index].get_type() for index in which]
    assert codec.dropped["bad_data"] >= len(which)


@given(st.lists(st.binary(max_size=400), min_size=1, max_size=5))
@settings(max_examples=30)
def test_the_receiver_keeps_no_more_than_it_needs(chunks: list[bytes]) -> None:
    codec = MavlinkCodec(1)
    for chunk in chunks * 40:
        codec.receive(chunk + b"\xfd\xff")
        assert len(codec._receiver.buf) < 6000


@given(st.lists(st.binary(max_size=300), max_size=5))
def test_any_bytes_from_the_client_are_survived(chunks: list[bytes]) -> None:
    made = autopilot()
    for chunk in chunks:
        made.mavlink.receive(chunk)
    made.mavlink.receive(bytes(600))
    heard = say(made, dialect.MAVLink_param_request_read_message(1, 1, b"RTL_ALT", -1))
    assert [m.param_id for m in heard if m.get_type() == "PARAM_VALUE"][-1] == "RTL_ALT"


@given(
    st.sampled_from([11, 16, 22, 20, 21, 176, 178, 192, 224, 300, 400, 410, 511, 512, 246, 9999]),
    st.lists(any_float, min_size=7, max_size=7),
    st.booleans(),
)
@settings(max_examples=100)
def test_any_command_is_acknowledged_once(number: int, parameters: list[float], armed: bool) -> None:
    made = autopilot(in_guided=armed)
    heard = say(made, dialect.MAVLink_command_long_message(1, 1, number, 0, *parameters))
    acknowledgements = [m for m in heard if m.get_type() == "COMMAND_ACK"]
    assert [m.command for m in acknowledgements] == [number]
    assert 0 <= acknowledgements[0].result <= 4


@given(st.binary(max_size=251), st.integers(0, 0xFFFF), st.integers(0, 2**32 - 1))
def test_any_request_for_files_and_logs_is_survived(payload: bytes, log: int, offset: int) -> None:
    files = dialect.MAVLink_file_transfer_protocol_message(0, 1, 1, payload.ljust(251, b"\0"))
    heard = say(autopilot(), files, dialect.MAVLink_log_request_data_message(1, 1, log, offset, 90))
    assert [m.count for m in heard if m.get_type() == "LOG_DATA"] == [0]


@given(
    st.integers(0, 4095),
    st.sampled_from([0, 1, 3, 5, 6, 7, 8, 9, 11, 21]),
    st.lists(any_float, min_size=11, max_size=11),
)
@settings(max_examples=80)
def test_any_position_target_is_survived(mask: int, frame: int, values: list[float]) -> None:
    made = autopilot(in_guided=True)
    made.vehicle.leave_ground()
    local = dialect.MAVLink_set_position_target_local_ned_message(0, 1, 1, frame, mask, *values)
    place = (2_000_000_000, -2_000_000_000) if mask & 1 else (450_000_000, 100_000_000)
    globe = dialect.MAVLink_set_position_target_global_int_message(0, 1, 1, frame, mask, *place, *values[2:])
    say(made, local, globe)
    for index in range(5):
        packet = turn(made, sensor_frame(5.0 + index * 0.01))
        assert packet is not None
        assert all(1000 <= output <= 2000 for output in struct.unpack("<HHI16H", packet)[3:7])


@given(st.floats(-2, 2), st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1), st.floats(0, 0.5))
def test_mixer_never_leaves_its_range(
    throttle: float, roll: float, pitch: float, yaw: float, lowest: float
) -> None:
    for command in QUAD_X.mix(throttle, roll, pitch, yaw, lowest):
        assert lowest - 1e-9 <= command <= 1.0 + 1e-9


in_flight = st.tuples(
    st.integers(0, 10**16).map(lambda ns: ns / 1e9),
    *[st.floats(-limit, limit) for limit in (300.0, 5e4, 1e6, 7.0, 1e3) for _ in range(3)],
    st.floats(-1e3, 1e3),
)


@given(in_flight)
def test_numbers_that_are_passed_are_those_of_the_datagram(numbers: tuple[float, ...]) -> None:
    """So that a stand-in flies the same in one process as in many."""
    passed = sensed_frame(make_rounder()(numbers))
    assert passed is not None
    assert passed == parse_sensor_frame(make_encoder()(numbers))
    for exact, rounded in zip(numbers, make_rounder()(numbers), strict=True):
        assert abs(exact - rounded) <= 5.1e-6
