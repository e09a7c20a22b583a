"""Signatures, made and checked by pymavlink on the other side."""

import hashlib

import pytest
from fastcrc.crc16 import mcrf4xx
from pymavlink.dialects.v10 import ardupilotmega as v1
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from aps.links.address import parse_address
from aps.links.link import Link
from aps.links.outbox import FrameQueue
from aps.wire.framer import Framer
from aps.wire.signing import EPOCH_UNIX_US, Signing, loggable, read_key

KEY = bytes(range(32))
NOW_US = 1_790_000_000_000_000
UNITS = (NOW_US - EPOCH_UNIX_US) // 10


def peer(key=KEY, timestamp=UNITS):
    mav = mavlink.MAVLink(None, srcSystem=7, srcComponent=1)
    mav.signing.secret_key, mav.signing.sign_outgoing = key, True
    mav.signing.link_id, mav.signing.timestamp = 3, timestamp
    return mav


def attitude(mav):
    return bytes(mavlink.MAVLink_attitude_message(1, 0.5, 0, 0, 0, 0, 0).pack(mav))


def frames(raw):
    return Framer(trusting=True).receive(raw)


def test_pymavlink_accepts_our_signatures():
    ours = Signing(KEY, lambda: NOW_US, link_id=5)
    plain = mavlink.MAVLink(None, srcSystem=5, srcComponent=1)
    reader = peer()
    for _ in range(3):
        raw = ours.sign(attitude(plain))
        (message,) = reader.parse_buffer(raw)
        assert (message.get_type(), message.get_signed(), message.roll) == ("ATTITUDE", True, 0.5)
    assert ours.counters.signed == 3
    with pytest.raises(mavlink.MAVError):
        peer(key=bytes(32)).parse_buffer(ours.sign(attitude(plain)))


def test_signatures_of_pymavlink_are_verified_and_count_once():
    ours, mav = Signing(KEY, lambda: NOW_US), peer()
    first, second = frames(attitude(mav) + attitude(mav))
    assert ours.verify(first)
    assert ours.verify(second)
    assert not ours.verify(first)  # again
    (forged,) = frames(attitude(peer(key=bytes(32))))
    assert not ours.verify(forged)
    (unsigned,) = frames(attitude(mavlink.MAVLink(None, srcSystem=7, srcComponent=1)))
    assert not ours.verify(unsigned)
    counters = ours.counters
    assert (counters.verified, counters.old, counters.bad, counters.unsigned) == (2, 1, 1, 1)


def test_a_new_sender_may_be_a_minute_behind():
    for seconds, taken in ((59, True), (61, False)):
        (frame,) = frames(attitude(peer(timestamp=UNITS - seconds * 100_000)))
        assert Signing(KEY, lambda: NOW_US).verify(frame) is taken


def test_radios_have_no_key():
    radio = mavlink.MAVLink(None, srcSystem=51, srcComponent=68)
    (frame,) = frames(bytes(mavlink.MAVLink_radio_status_message(1, 2, 3, 4, 5, 6, 7).pack(radio)))
    assert Signing(KEY, lambda: NOW_US).verify(frame)


def test_what_cannot_or_need_not_be_signed():
    ours = Signing(KEY, lambda: NOW_US)
    old = v1.MAVLink_attitude_message(1, 0, 0, 0, 0, 0, 0).pack(v1.MAVLink(None, srcSystem=7, srcComponent=1))
    assert ours.sign(bytes(old)) is None
    signed = attitude(peer())
    assert ours.sign(signed) == signed
    assert ours.counters.not_signable == 1


def test_an_unknown_message_is_signed_with_its_own_definition():
    from fastcrc.crc16 import mcrf4xx

    body = bytes([3, 0, 0, 0, 7, 1]) + (60_001).to_bytes(3, "little") + b"abc"
    raw = Signing(KEY, lambda: NOW_US).sign(b"\xfd" + body + mcrf4xx(body + b"\x33").to_bytes(2, "little"))
    (frame,) = frames(raw)
    assert frame.signed
    crc_at = frame.payload_start + frame.payload_bytes
    assert mcrf4xx(raw[1:crc_at] + b"\x33").to_bytes(2, "little") == raw[crc_at : crc_at + 2]
    assert Signing(KEY, lambda: NOW_US).verify(frame)


def test_keys_from_files(tmp_path):
    file = tmp_path / "key"
    file.write_text(KEY.hex() + "\n")
    assert read_key(file) == KEY
    file.write_text("correct horse\n")
    assert read_key(file) == hashlib.sha256(b"correct horse").digest()
    file.write_text("")
    with pytest.raises(ValueError, match="has no key"):
        read_key(file)
    with pytest.raises(ValueError, match=r"rule 'key=.*missing'"):
        parse_address(f"udp-out:h:1,key={tmp_path / 'missing'}")
    with pytest.raises(ValueError, match="a key has 32 bytes"):
        Signing(b"short", lambda: NOW_US)


def test_a_link_with_a_key_takes_only_what_is_signed_and_signs_what_it_sends(tmp_path):
    (tmp_path / "key").write_text(KEY.hex())
    address = parse_address(f"udp-out:h:1,key={tmp_path / 'key'}")
    assert KEY.hex() not in repr(address)
    assert str(KEY) not in repr(address)
    link, other = Link("x", FrameQueue(), address.opening), Link("y", FrameQueue(), address.opening)
    link.outbox.admit()
    raw = attitude(mavlink.MAVLink(None, srcSystem=7, srcComponent=1))
    link.send(raw)
    signed = link.outbox.take(1000)
    assert len(signed) == len(raw) + 13
    assert [frame.raw for frame in other.receive(raw + signed, 0)] == [signed]
    assert other.statistics(0)["signing"]["unsigned"] == 1


def test_logs_have_no_signature_and_no_key():
    """As pymavlink reads them, with and without a definition of the message."""
    plain = mavlink.MAVLink(None, srcSystem=7, srcComponent=1)
    for raw in (attitude(peer()), unknown_to_us(attitude(peer()))):
        told = loggable(raw)
        assert len(told) == len(raw) - 13
        (frame,) = frames(told)
        assert (frame.signed, frame.payload) == (False, frames(raw)[0].payload)
    (message,) = plain.parse_buffer(loggable(attitude(peer())))
    assert message.roll == 0.5
    unsigned = attitude(plain)
    assert loggable(unsigned) == unsigned
    for mav in (plain, peer()):
        assert loggable(bytes(mavlink.MAVLink_setup_signing_message(7, 1, KEY, 1).pack(mav))) is None


def unknown_to_us(raw):
    """The same with an id of no message."""
    covered = raw[1:7] + (54321).to_bytes(3, "little") + raw[10:-15]
    crc = mcrf4xx(covered + b"\x07").to_bytes(2, "little")
    return raw[:1] + covered + crc + raw[-13:]


def test_a_new_sender_is_heard_when_many_were_long_ago():
    now_us = NOW_US
    ours = Signing(KEY, lambda: now_us)

    def hears(link_id, timestamp):
        mav = peer(timestamp=timestamp)
        mav.signing.link_id = link_id
        (frame,) = frames(attitude(mav))
        return ours.verify(frame)

    assert all(hears(number, UNITS) for number in range(256))
    other = mavlink.MAVLink(None, srcSystem=8, srcComponent=1)
    other.signing.secret_key, other.signing.sign_outgoing, other.signing.timestamp = KEY, True, UNITS + 1
    (early,) = frames(attitude(other))
    assert not ours.verify(early)  # to forget one of them would let its frames be taken twice
    now_us += 61_000_000
    other.signing.timestamp = UNITS + 6_100_000
    (late,) = frames(attitude(other))
    assert ours.verify(late)
    assert not hears(0, UNITS)  # forgotten, and too old for a new one


@pytest.mark.parametrize("timestamp", [2**48 - 2, 2**48 - 2**32])
def test_a_timestamp_that_none_can_come_after_is_refused_and_ours_go_on(timestamp):
    ours = Signing(KEY, lambda: NOW_US)
    (last,) = frames(attitude(peer(timestamp=timestamp)))
    assert not ours.verify(last)
    assert ours.counters.bad == 1
    signed = [ours.sign(attitude(mavlink.MAVLink(None))) for _ in range(2)]
    assert [frame.signed for frame in frames(b"".join(signed))] == [True, True]
    (next_one,) = frames(attitude(peer()))
    assert ours.verify(next_one)
