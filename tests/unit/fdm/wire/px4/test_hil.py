"""The codec against pymavlink, another implementation, and against bytes that a real PX4 has sent."""

import pytest
from pymavlink.dialects.v20 import common

from fdm.wire.px4 import hil
from fdm.wire.px4.mavlink import FrameReader, FrameWriter
from tests.px4_recording import recorded

SENSOR = hil.HilSensor(
    1_234_567, (0.1, -0.2, -9.8), (0.01, 0.02, -0.03), (0.2, 0.01, 0.43), 956.25, 0.5, 488.5, 11.75, 0x1FFF
)


def read_by_pymavlink(data):
    return common.MAVLink(None).parse_buffer(data)


def single(value):
    """As four bytes have it."""
    return pytest.approx(value, rel=1e-6)


def test_hil_sensor_is_what_pymavlink_reads():
    (message,) = read_by_pymavlink(hil.sensor_frame(FrameWriter(0, 200), SENSOR))
    assert message.get_type() == "HIL_SENSOR"
    assert message.time_usec == 1_234_567
    assert (message.xacc, message.yacc, message.zacc) == (single(0.1), single(-0.2), single(-9.8))
    assert (message.xgyro, message.ygyro, message.zgyro) == (single(0.01), single(0.02), single(-0.03))
    assert (message.xmag, message.ymag, message.zmag) == (single(0.2), single(0.01), single(0.43))
    assert (message.abs_pressure, message.diff_pressure) == (956.25, 0.5)
    assert (message.pressure_alt, message.temperature, message.fields_updated) == (488.5, 11.75, 0x1FFF)
    assert message.id == 0


def test_hil_gps_is_what_pymavlink_reads():
    gps = hil.HilGps(1_700_000_000_000_000, 47.3977, -8.5456, 488.25, 0.9, 1.5, (3.0, -4.0, -0.25))
    (message,) = read_by_pymavlink(hil.gps_frame(FrameWriter(0, 200), gps))
    assert (message.time_usec, message.fix_type, message.satellites_visible) == (1_700_000_000_000_000, 3, 10)
    assert (message.lat, message.lon, message.alt) == (473977000, -85456000, 488250)
    assert (message.eph, message.epv, message.vel) == (90, 150, 500)
    assert (message.vn, message.ve, message.vd, message.cog) == (300, -400, -25, 65535)


def test_hil_state_quaternion_is_what_pymavlink_reads():
    state = hil.HilState(
        7,
        (1.0, 0.0, 0.0, 0.0),
        (0.5, 0.0, 0.0),
        1.5,
        2.5,
        3.5,
        (1.0, 2.0, -400.0),
        20.0,
        21.0,
        (0.0, 0.0, -9.80665),
    )
    (message,) = read_by_pymavlink(hil.state_frame(FrameWriter(0, 200), state))
    assert list(message.attitude_quaternion) == [1.0, 0.0, 0.0, 0.0]
    assert (message.rollspeed, message.lat, message.lon, message.alt) == (0.5, 15000000, 25000000, 3500)
    assert (message.vx, message.vy, message.vz) == (100, 200, -32768), "what does not fit is cut"
    assert (message.ind_airspeed, message.true_airspeed, message.zacc) == (2000, 2100, -1000)


@pytest.mark.parametrize("version", [1, 2])
def test_what_pymavlink_writes_is_read(version):
    mav = common.MAVLink(None, srcSystem=1, srcComponent=1)
    controls = [0.25, 0.5, -1.0, 1.0] + [0.0] * 12
    message = common.MAVLink_hil_actuator_controls_message(8000, controls, 0x81, 1)
    ((message_id, payload),) = FrameReader(hil.FROM_PX4).feed(message.pack(mav, force_mavlink1=version == 1))
    assert message_id == 93
    assert hil.read_actuators(payload) == hil.ActuatorControls(8000, tuple(controls), True)


def test_a_frame_with_a_wrong_bit_is_dropped_and_the_next_one_read():
    writer = FrameWriter(1, 1)
    first, second = (
        hil.actuators_frame(writer, hil.ActuatorControls(time_us, (0.5,) * 16, False))
        for time_us in (4000, 8000)
    )
    reader = FrameReader(hil.FROM_PX4)
    broken = first[:20] + bytes((first[20] ^ 4,)) + first[21:]
    found = reader.feed(broken + second)
    assert [hil.read_actuators(payload).time_us for _, payload in found] == [8000]
    assert reader.counters["bad_checksum"] == 1


def test_controls_that_are_no_numbers_are_no_answer():
    answer = hil.ActuatorControls(4000, (float("nan"),) + (0.0,) * 15, True)
    ((_, payload),) = FrameReader(hil.FROM_PX4).feed(hil.actuators_frame(FrameWriter(1, 1), answer))
    assert hil.read_actuators(payload) is None


def test_pulse_widths_of_motors_and_servos():
    widths = hil.pulse_widths([0.0, 0.4255, 1.5, -0.25, 0.0, -2.0], frozenset({1, 2, 3}))
    assert widths == (1000, 1426, 2000, 1375, 1500, 1000)  # 1500 - 125; a servo's middle; its end


def test_what_a_real_px4_answered():
    reader = FrameReader(hil.FROM_PX4)
    answers = [
        hil.read_actuators(payload) for data in recorded(from_px4=True) for _, payload in reader.feed(data)
    ]
    assert [answer.time_us for answer in answers[:3]] == [36000, 40000, 44000], "from frame 9 of 4 ms on"
    assert not answers[0].is_armed
    assert not any(answers[0].controls)
    assert answers[-1].is_armed
    assert all(0 < control < 0.5 for control in answers[-1].controls[:4])
    assert not any(answers[-1].controls[4:])
    assert dict(reader.counters) == {"other_messages": 2}, "HEARTBEAT and COMMAND_LONG, when it connected"


def test_what_a_real_px4_was_sent_is_read_by_pymavlink():
    messages = read_by_pymavlink(b"".join(recorded(from_px4=False)))
    sensors = [message for message in messages if message.get_type() == "HIL_SENSOR"]
    assert [message.time_usec for message in sensors[:3]] == [4000, 8000, 12000]
    assert sum(message.get_type() == "HIL_GPS" for message in messages[:50]) == 2, "10 Hz beside 250 Hz"
    assert [message.get_seq() for message in messages[:5]] == [0, 1, 2, 3, 4]
