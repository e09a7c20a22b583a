import math
import struct

import pytest

from fdm.errors import ModelDivergedError
from fdm.model.geodesy import GeodeticPosition, Home
from fdm.wire.legacy import (
    decode_legacy_state,
    encode_legacy_servos,
    make_legacy_encoder,
    make_legacy_unpacker,
)

HOME = Home(GeodeticPosition(47.0, 8.0, 400.0), 0.0)
PWM = tuple(range(1100, 1111))
VALUES = (1.5, 0.1, 0.2, 0.3, 1.0, 2.0, -9.8, 0.0, 0.0, -20.0, 0.05, -0.1, -math.pi / 2, 4.0, 5.0, -6.0, 7.5)


def test_servos_are_fourteen_integers():
    assert encode_legacy_servos(PWM) == struct.pack("<14H", *PWM, 0, 0, 0)
    with pytest.raises(ValueError, match="expected 14"):
        encode_legacy_servos(PWM[:-1])


def test_each_packet_asks_for_the_next_frame():
    unpack = make_legacy_unpacker(200)
    for count in range(3):
        assert unpack(encode_legacy_servos(PWM)) == (0, 200, count, *PWM, 0, 0, 0, 0, 0)
    assert unpack(b"\0" * 27) == "bad_length"
    assert unpack(encode_legacy_servos(PWM))[2] == 3
    with pytest.raises(ValueError, match="rate_hz = 5"):
        make_legacy_unpacker(5)


def test_the_state_is_laid_out_as_in_2015():
    datagram = make_legacy_encoder(HOME)(VALUES)
    assert len(datagram) == 148
    fields = struct.unpack("<Q17dI", datagram)
    assert fields[0] == 1_500_000
    assert fields[1:5] == pytest.approx((47.0, 8.0, 420.0, 270.0))
    assert fields[5:8] == (4.0, 5.0, -6.0)
    assert fields[8:11] == (1.0, 2.0, -9.8)
    assert fields[11:14] == pytest.approx([math.degrees(v) for v in (0.1, 0.2, 0.3)])
    assert fields[14:17] == pytest.approx([math.degrees(v) for v in (0.05, -0.1, -math.pi / 2)])
    assert fields[17:] == (7.5, 0x4C56414F)


def test_the_state_is_read_back_and_garbage_is_not():
    datagram = make_legacy_encoder(HOME)(VALUES)
    state = decode_legacy_state(datagram)
    assert (state.time_us, state.velocity_ned_mps) == (1_500_000, (4.0, 5.0, -6.0))
    assert decode_legacy_state(datagram[:-1]) is None
    assert decode_legacy_state(datagram[:-1] + b"\0") is None
    assert decode_legacy_state(struct.pack("<Q17dI", 0, *(math.nan,) * 17, 0x4C56414F)) is None


def test_a_measured_place_beyond_the_pole_is_at_the_pole():
    encode = make_legacy_encoder(Home(GeodeticPosition(89.99999, 8.0, 400.0), 0.0))
    state = decode_legacy_state(encode((*VALUES[:7], 3.0, *VALUES[8:])))
    assert state.position.lat_deg == 90.0


def test_no_number_that_is_not_finite_is_sent():
    with pytest.raises(ModelDivergedError):
        make_legacy_encoder(HOME)((math.nan, *VALUES[1:]))
