import math

import pytest

from fdm.errors import ModelDivergedError
from fdm.model.geodesy import GeodeticPosition, Home
from fdm.wire.legacy import make_legacy_encoder, make_legacy_unpacker
from tests.unit.fdm.wire.legacy_peer import STATE, servos, state_of

HOME = Home(GeodeticPosition(47.0, 8.0, 400.0), 0.0)
PWM = tuple(range(1100, 1111))
VALUES = (1.5, 0.1, 0.2, 0.3, 1.0, 2.0, -9.8, 0.0, 0.0, -20.0, 0.05, -0.1, -math.pi / 2, 4.0, 5.0, -6.0, 7.5)


def test_each_packet_asks_for_the_next_frame():
    unpack = make_legacy_unpacker(200)
    for count in range(3):
        assert unpack(servos(PWM)) == (0, 200, count, *PWM, 0, 0, 0, 0, 0)
    assert unpack(b"\0" * 27) == "bad_length"
    assert unpack(servos(PWM))[2] == 3
    with pytest.raises(ValueError, match="rate_hz = 5"):
        make_legacy_unpacker(5)


def test_the_state_is_laid_out_as_in_2015():
    datagram = make_legacy_encoder(HOME)(VALUES)
    assert len(datagram) == 148
    fields = STATE.unpack(datagram)
    assert fields[0] == 1_500_000
    assert fields[1:5] == pytest.approx((47.0, 8.0, 420.0, 270.0))
    assert fields[5:8] == (4.0, 5.0, -6.0)
    assert fields[8:11] == (1.0, 2.0, -9.8)
    assert fields[11:14] == pytest.approx([math.degrees(v) for v in (0.1, 0.2, 0.3)])
    assert fields[14:17] == pytest.approx([math.degrees(v) for v in (0.05, -0.1, -math.pi / 2)])
    assert fields[17:] == (7.5, 0x4C56414F)


def test_a_measured_place_beyond_the_pole_is_at_the_pole():
    encode = make_legacy_encoder(Home(GeodeticPosition(89.99999, 8.0, 400.0), 0.0))
    assert state_of(encode((*VALUES[:7], 3.0, *VALUES[8:]))).lat_deg == 90.0


def test_no_number_that_is_not_finite_is_sent():
    with pytest.raises(ModelDivergedError):
        make_legacy_encoder(HOME)((math.nan, *VALUES[1:]))
