import struct

import pytest

from fdm.wire.servo_packet import ServoPacket, encode_servo_packet, unpack_servo_packet

PWM_16 = tuple(range(1000, 1016))


def test_sixteen_channels_are_laid_out_as_ardupilot_does():
    datagram = encode_servo_packet(ServoPacket(1200, 7, PWM_16))
    assert datagram == struct.pack("<HHI16H", 18458, 1200, 7, *PWM_16)
    assert len(datagram) == 40


def test_thirty_two_channels_have_their_own_magic():
    pwm = tuple(range(1100, 1132))
    datagram = encode_servo_packet(ServoPacket(400, 2**32 - 1, pwm))
    assert len(datagram) == 72
    assert struct.unpack_from("<HHI", datagram) == (29569, 400, 2**32 - 1)
    assert unpack_servo_packet(datagram) == (29569, 400, 2**32 - 1, *pwm)


@pytest.mark.parametrize(
    ("datagram", "reason"),
    [
        (b"", "bad_length"),
        (b"\0" * 41, "bad_length"),
        (struct.pack("<HHI16H", 18459, 400, 0, *PWM_16), "bad_magic"),
        (struct.pack("<HHI16H", 29569, 400, 0, *PWM_16), "bad_magic"),
        (struct.pack("<HHI16H", 18458, 0, 0, *PWM_16), "bad_frame_rate"),
        (struct.pack("<HHI16H", 18458, 9, 0, *PWM_16), "bad_frame_rate"),
    ],
)
def test_a_bad_datagram_is_refused_with_its_reason(datagram, reason):
    assert unpack_servo_packet(datagram) == reason


@pytest.mark.parametrize(
    "packet", [ServoPacket(400, 0, (1500,) * 15), ServoPacket(70000, 0, PWM_16), ServoPacket(400, -1, PWM_16)]
)
def test_what_does_not_fit_is_a_callers_mistake(packet):
    with pytest.raises(ValueError, match=r"16 or 32|ServoPacket"):
        encode_servo_packet(packet)
