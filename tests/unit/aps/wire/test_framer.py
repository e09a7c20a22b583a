import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from aps.wire.framer import MAX_FRAME_BYTES, Framer, with_payload


def sender(sysid=7, compid=1):
    return mavlink.MAVLink(None, srcSystem=sysid, srcComponent=compid)


def attitude(mav, ms=1000, **kwargs):
    return bytes(mavlink.MAVLink_attitude_message(ms, 0.1, 0.2, 0.3, 0.01, 0.02, 0.03).pack(mav, **kwargs))


def signing(mav):
    mav.signing.secret_key = b"k" * 32
    mav.signing.link_id = 3
    mav.signing.timestamp = 12345
    mav.signing.sign_outgoing = True
    return mav


def test_frame_tells_header_and_original_bytes():
    mav = sender(sysid=42, compid=191)
    mav.seq = 200
    raw = attitude(mav)
    (frame,) = Framer().receive(raw)
    assert (frame.raw, frame.msg_id, frame.sysid, frame.compid, frame.seq) == (raw, 30, 42, 191, 200)
    assert frame.payload == raw[10:-2]
    assert (frame.target_system, frame.target_component) == (0, 0)


def test_mavlink1_frame():
    raw = attitude(sender(), force_mavlink1=True)
    assert raw[0] == 0xFE
    framer = Framer()
    (frame,) = framer.receive(raw)
    assert (frame.raw, frame.msg_id, frame.sysid, frame.payload) == (raw, 30, 7, raw[6:-2])
    assert framer.counters.frames_v1 == 1


def test_signed_frame_passes_whole():
    raw = attitude(signing(sender()))
    plain = attitude(sender())
    framer = Framer()
    signed, unsigned = framer.receive(raw + plain)
    assert signed.raw == raw
    assert signed.signed
    assert len(raw) == len(plain) + 13
    assert not unsigned.signed
    assert framer.counters.signed == 1


@pytest.mark.parametrize("force_mavlink1", [False, True])
def test_targets_of_a_command(force_mavlink1):
    message = mavlink.MAVLink_command_long_message(9, 154, 400, 0, 1, 0, 0, 0, 0, 0, 0)
    (frame,) = Framer().receive(bytes(message.pack(sender(), force_mavlink1=force_mavlink1)))
    assert (frame.target_system, frame.target_component) == (9, 154)


def test_target_trimmed_off_the_payload_is_zero():
    # target_system 5, target_component 0 and no force_sync: both trailing bytes are trimmed away.
    message = mavlink.MAVLink_param_request_list_message(5, 0)
    raw = bytes(message.pack(sender()))
    assert raw[1] == 1
    (frame,) = Framer().receive(raw)
    assert (frame.target_system, frame.target_component) == (5, 0)


def test_targets_agree_with_pymavlink_for_every_message_that_has_them():
    framer = Framer()
    mav = sender()
    checked = 0
    for cls in mavlink.mavlink_map.values():
        if "target_system" not in cls.fieldnames:
            continue
        values = []
        lengths = dict(zip(cls.ordered_fieldnames, cls.array_lengths, strict=True))
        for name, kind in zip(cls.fieldnames, cls.fieldtypes, strict=True):
            if name == "target_system":
                values.append(33)
            elif name == "target_component":
                values.append(44)
            elif kind == "char":
                values.append(b"a")
            else:
                values.append([1] * lengths[name] if lengths[name] > 1 else 1)
        (frame,) = framer.receive(bytes(cls(*values).pack(mav)))
        assert frame.target_system == 33, cls.msgname
        assert frame.target_component == (44 if "target_component" in cls.fieldnames else 0), cls.msgname
        checked += 1
    assert checked > 60


def test_garbage_is_skipped_counted_and_followed_by_frames():
    mav = sender()
    first, second = attitude(mav), attitude(mav)
    framer = Framer()
    frames = framer.receive(b"\x00\x01garbage" + first + b"xyz" + second)
    assert [frame.raw for frame in frames] == [first, second]
    assert framer.counters.skipped_bytes == 9 + 3
    assert framer.counters.frames == 2


def test_wrong_checksum_is_counted_and_the_next_frame_found():
    mav = sender()
    bad, good = bytearray(attitude(mav)), attitude(mav)
    bad[12] ^= 0x40
    framer = Framer()
    frames = framer.receive(bytes(bad) + good)
    assert [frame.raw for frame in frames] == [good]
    assert framer.counters.bad_crc >= 1


def test_frame_behind_a_false_start_marker_is_found():
    good = attitude(sender())
    framer = Framer()
    assert [frame.raw for frame in framer.receive(b"\xfd\x05" + good * 12)] == [good] * 12


def test_unknown_incompatibility_flag_is_refused():
    raw = bytearray(attitude(sender()))
    raw[2] = 0x02
    framer = Framer()
    assert framer.receive(bytes(raw)) == []
    assert framer.counters.bad_flags == 1


def unknown_message(extra, payload=b"abcdefgh"):
    """Of system 7, component 1, as `sender()` is."""
    from fastcrc.crc16 import mcrf4xx

    body = bytes([len(payload), 0, 0, 9, 7, 1]) + (60_000).to_bytes(3, "little") + payload
    return b"\xfd" + body + mcrf4xx(body + bytes([extra])).to_bytes(2, "little")


def heard():
    """A framer that has heard system 7."""
    framer = Framer()
    assert len(framer.receive(attitude(mavlink.MAVLink(None, srcSystem=7, srcComponent=1)))) == 1
    return framer


def test_message_of_unknown_id_passes_for_any_definition():
    framer = heard()
    for extra in range(256):
        raw = unknown_message(extra)
        assert [frame.raw for frame in framer.receive(raw)] == [raw]
    assert framer.counters.unknown_id == 256


def test_message_of_unknown_id_is_not_believed_of_a_sender_that_was_never_heard():
    framer = Framer()
    assert framer.receive(unknown_message(17)) == []
    assert framer.counters.unknown_sender == 1
    framer = heard()
    framer.reset()  # another stream may have other senders
    assert framer.receive(unknown_message(17)) == []
    assert len(Framer(trusting=True).receive(unknown_message(17))) == 1


def test_twenty_megabytes_of_noise_are_no_frame():
    generator = np.random.default_rng(11)
    framer = heard()
    assert sum(len(framer.receive(generator.bytes(1 << 16))) for _ in range(20 * 16)) == 0


def test_unknown_id_with_a_checksum_of_no_definition_is_refused():
    raw = unknown_message(17)
    accepted = 0
    for crc in range(0, 65536, 16):
        accepted += len(heard().receive(raw[:-2] + crc.to_bytes(2, "little")))
    assert 0 < accepted <= 64  # 256 of 65536 checksums are possible; we tried one in 16


def test_byte_by_byte_gives_the_frame_with_its_last_byte():
    raw = attitude(sender())
    framer = Framer()
    for byte in raw[:-1]:
        assert framer.receive(bytes([byte])) == []
    assert [frame.raw for frame in framer.receive(raw[-1:])] == [raw]
    assert framer.pending_bytes == 0


def test_memory_is_bounded():
    framer = Framer()
    for _ in range(100):
        framer.receive(b"\xfd\xff" * 500)
        assert framer.pending_bytes <= MAX_FRAME_BYTES


def test_reset_forgets_the_incomplete_frame():
    raw = attitude(sender())
    framer = Framer()
    framer.receive(raw[:20])
    framer.reset()
    assert framer.pending_bytes == 0
    assert [frame.raw for frame in framer.receive(raw)] == [raw]
    assert framer.counters.skipped_bytes == 20


def test_with_payload_keeps_sender_and_sequence():
    mav = sender(sysid=255, compid=190)
    mav.seq = 77
    raw = bytes(mavlink.MAVLink_command_long_message(1, 1, 511, 0, 30, 1e6, 0, 0, 0, 0, 0).pack(mav))
    (frame,) = Framer().receive(raw)
    changed = mavlink.MAVLink_command_long_message(1, 1, 511, 0, 30, 5e4, 0, 0, 0, 0, 0)
    changed.pack(sender())
    rewritten = with_payload(frame, bytes(changed.get_payload()).ljust(33, b"\0"))
    (message,) = mavlink.MAVLink(None).parse_buffer(rewritten)
    assert (message.get_srcSystem(), message.get_srcComponent(), message.get_seq()) == (255, 190, 77)
    assert (message.param1, message.param2, message.command) == (30, 5e4, 511)


def test_with_payload_refuses_what_it_cannot_sign():
    (frame,) = Framer().receive(attitude(signing(sender())))
    with pytest.raises(ValueError, match="cannot be rewritten"):
        with_payload(frame, b"")
