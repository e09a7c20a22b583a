import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from aps.vehicle.autopilots.choice import autopilot_of
from aps.wire.dialect import Encoder, enum_label, message_fields, message_name


@pytest.mark.parametrize("vehicle", [mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_TYPE_FIXED_WING])
def test_modes_are_spelled_as_ground_stations_do(vehicle):
    theirs = {name: number for number, name in mavutil.mode_mapping_bynumber(vehicle).items()}
    ours = autopilot_of(3).modes(vehicle)
    assert len(ours) > 20
    assert {name: theirs.get(name) for name in ours} == ours


def test_type_without_modes():
    assert autopilot_of(3).modes(mavlink.MAV_TYPE_GCS) == {}


def test_labels():
    assert enum_label("MAV_RESULT", 2) == "DENIED"
    assert enum_label("MAV_RESULT", 200) == "200"
    assert message_name(30) == "ATTITUDE"
    assert message_name(60_000) == "UNKNOWN_60000"


def test_encoder_counts_its_sequence():
    encoder = Encoder(3, 191)
    parser = mavlink.MAVLink(None)
    for expected in [*range(256), 0]:
        (message,) = parser.parse_buffer(encoder.encode(mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3)))
        assert (message.get_srcSystem(), message.get_srcComponent()) == (3, 191)
        assert message.get_seq() == expected


@pytest.mark.parametrize(("sysid", "compid"), [(0, 1), (256, 1), (1, 0)])
def test_encoder_refuses_impossible_ids(sysid, compid):
    with pytest.raises(ValueError, match=r"must be in 1\.\.255"):
        Encoder(sysid, compid)


def test_fields_of_a_frame_and_none_of_what_is_no_frame():
    raw = Encoder(1, 1).encode(mavlink.MAVLink_statustext_message(3, b"hello"))
    assert message_fields(raw) == {"severity": 3, "text": "hello", "id": 0, "chunk_seq": 0}
    for broken in (b"", raw[:-1], raw[:-1] + bytes([raw[-1] ^ 1]), b"\xfd" + bytes(20)):
        assert message_fields(broken) == {}
