"""The same frames through the daemon and through a real mavlink-router: the same ones come out, but for what docs name.

MAVLINK_ROUTERD or PATH leads to a mavlink-routerd built from its repository.
"""

from collections import Counter
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from aps.wire.framer import Framer
from tests.interop.mavlink_router.router_bench import bench_with, mavlink_routerd
from tests.unit.aps.hub.test_forwarding import (
    ALL,
    AP,
    CAM,
    CASES,
    GCS,
    MUTE,
    UAV,
    attitude,
    bytes_of,
    command,
    heartbeat,
    unknown_frame,
)

RECORDING = Path(__file__).parents[2] / "data" / "mavlink_arducopter.bin"
SYSID = 4
"""Of the recording's autopilot."""

HEARD_THERE = "sender heard there"
UNSEEN = "unseen component"
LINK_LOCAL = "link-local"
FORGED = "autopilot's ids"
UNKNOWN = "unknown message"
DIFFERENCES = {
    # Case -> (the difference as docs/reference/aps.md names it, where mavlink-router sends the frame).
    "to a component that nobody has seen": (UNSEEN, set()),
    "to a component behind the same link": (UNSEEN, set()),
    "to another component of the ground station": (UNSEEN, set()),
    "to a component of it that nobody has seen": (UNSEEN, set()),
    "RADIO_STATUS": (LINK_LOCAL, ALL - {GCS}),
    "RADIO": (LINK_LOCAL, ALL - {AP}),
    "what the autopilot says, from elsewhere": (FORGED, ALL - {GCS, AP}),
    "the autopilot's heartbeat from elsewhere": (FORGED, ALL - {UAV, AP}),
}


@pytest.fixture
def routerd():
    return mavlink_routerd()


async def out_of(router, folder, name, sender, message):
    """Where a frame comes out, and what else does."""
    async with bench_with(router, folder, 5) as bench:
        raw = bytes_of(message, sender)
        speaker = sender if name == MUTE else {AP: (5, 1), GCS: (255, 190), CAM: (5, 100), UAV: (7, 1)}[name]
        await bench.say(name, speaker, raw)
        came = bench.came()
    extra = [frame for frames in came.values() for frame in frames.elements() if frame != raw]
    assert all(frames[raw] <= 1 for frames in came.values())
    return {end for end, frames in came.items() if raw in frames}, extra


@pytest.mark.parametrize(("what", "name", "sender", "message", "to"), CASES, ids=[case[0] for case in CASES])
async def test_case_by_case(routerd, tmp_path, what, name, sender, message, to):
    ours, ours_extra = await out_of("aps", tmp_path, name, sender, message)
    theirs, theirs_extra = await out_of(routerd, tmp_path, name, sender, message)
    assert ours == to
    assert theirs == (DIFFERENCES[what][1] if what in DIFFERENCES else to)
    assert theirs_extra == []
    assert all(Framer().receive(frame)[0].compid == 191 for frame in ours_extra)  # the daemon's own


MORE = [
    # Differences that no case of the table shows: name; from where, by whom; frame; where ours and theirs go.
    (UNKNOWN, GCS, (255, 190), unknown_frame((99, 99)), set(), ALL - {GCS}),
    (HEARD_THERE, UAV, (7, 1), bytes_of(attitude(), (255, 190)), ALL - {UAV}, ALL - {UAV, GCS}),
]


@pytest.mark.parametrize(
    ("what", "name", "speaker", "raw", "to", "theirs"), MORE, ids=[row[0] for row in MORE]
)
async def test_further_differences(routerd, tmp_path, what, name, speaker, raw, to, theirs):
    for router, ends in (("aps", to), (routerd, theirs)):
        async with bench_with(router, tmp_path, 5) as bench:
            await bench.say(name, speaker, raw)
            # pymavlink does not cut an unknown frame out whole: what has come is looked for in all bytes.
            assert {one for one, end in bench.ends.items() if raw in end.received} == ends


async def test_after_a_forgery_a_link_still_gets_the_autopilots_telemetry(routerd, tmp_path):
    forged, told = (
        bytes_of(attitude(), (5, 1)),
        bytes_of(mavlink.MAVLink_vfr_hud_message(1, 2, 3, 4, 5, 6), (5, 1)),
    )
    for router, ends in (("aps", ALL - {AP}), (routerd, ALL - {AP, GCS})):
        async with bench_with(router, tmp_path, 5) as bench:
            await bench.say(GCS, (255, 190), forged)
            bench.ends[AP].transport.write(told)
            for name in (CAM, MUTE, UAV):
                await bench.ends[name].until(told)
            await bench.say(UAV, (7, 1))  # what went to the others has come there, too
            assert {name for name, came in bench.came().items() if told in came} == ends


def test_docs_name_each_difference():
    text = (Path(__file__).parents[3] / "docs" / "reference" / "aps.md").read_text()
    section = text[text.index("### Beside mavlink-router") :]
    for name in {name for name, _ in DIFFERENCES.values()} | {row[0] for row in MORE}:
        assert f"| {name} |" in section
    assert set(DIFFERENCES) <= {case[0] for case in CASES}


def conversation():
    """What clients say beside the recording: (endpoint, sender, message), for one every 20 frames of the autopilot."""
    asked = mavlink.MAVLink_param_request_read_message(SYSID, 1, b"SYSID_THISMAV", -1)
    return [
        (GCS, (255, 190), heartbeat()),
        (GCS, (255, 190), asked),
        (GCS, (255, 190), command(SYSID, 1)),
        (GCS, (255, 190), command(SYSID, 100)),
        (CAM, (SYSID, 100), heartbeat()),
        (CAM, (SYSID, 100), mavlink.MAVLink_command_ack_message(400, 0, 0, 0, 255, 190)),
        (CAM, (SYSID, 100), attitude()),
        (UAV, (7, 1), heartbeat()),
        (UAV, (7, 1), mavlink.MAVLink_global_position_int_message(1, 2, 3, 4, 5, 6, 7, 8, 9)),
        (GCS, (255, 190), command(7, 1)),
        (GCS, (255, 190), command(0, 0)),
        (UAV, (7, 1), mavlink.MAVLink_command_ack_message(400, 0, 0, 0, 255, 190)),
        (GCS, (255, 190), mavlink.MAVLink_mission_count_message(SYSID, 1, 3)),
        (GCS, (255, 190), mavlink.MAVLink_set_mode_message(SYSID, 1, 4)),
    ]


async def played(router, folder):
    """The recording and the conversation, in one order; returns the frames that came, by endpoint."""
    frames = [frame.raw for frame in Framer().receive(RECORDING.read_bytes())]
    said = conversation()
    async with bench_with(router, folder, SYSID) as bench:
        for turn, at in enumerate(range(0, len(frames), 20)):
            await bench.say(AP, (SYSID, 1), *frames[at : at + 20])
            name, sender, message = said[turn % len(said)]
            await bench.say(name, sender, bytes_of(message, sender))
        return bench.came()


async def test_a_real_flight_and_its_clients(routerd, tmp_path):
    ours, theirs = await played("aps", tmp_path), await played(routerd, tmp_path)
    for name in (GCS, CAM, UAV, MUTE):
        assert ours[name] == theirs[name], name
    assert theirs[AP] - ours[AP] == Counter()
    for raw, _ in (ours[AP] - theirs[AP]).items():  # the daemon's own, and what nobody has been seen for
        frame = Framer().receive(raw)[0]
        assert frame.compid == 191 or (frame.target_component, UNSEEN) == (100, "unseen component")
    assert theirs[GCS].total() > 1400
