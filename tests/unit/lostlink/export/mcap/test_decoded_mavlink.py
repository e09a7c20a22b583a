"""MAVLink by its fields, in the MCAP file, and its metadata: the numbers are those of the frames."""

from __future__ import annotations

import os
from pathlib import Path

from pymavlink.dialects.v20 import ardupilotmega as mavlink
from rosbags.highlevel import AnyReader

from bridge.record import names
from bridge.record.streams import Entry
from bridge.scenario.file import read_scenario
from lostlink.export.mcap.export import write_mcap
from tests.unit.bridge.record.runs import RunContent, make_run
from tests.unit.lostlink.export.mcap.files import read_mcap

UIDS = [(1 << 64) - 2, 3, 1 << 63]


def version(made: RunContent) -> None:
    sender = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    frames = [
        mavlink.MAVLink_autopilot_version_message(0, 1, 2, 3, 4, [0] * 8, [0] * 8, [0] * 8, 5, 6, uid).pack(
            sender
        )
        for uid in UIDS
    ]
    stream = names.Stream(names.Kind.FROM_AUTOPILOT, "0")
    made.streams[stream] = [Entry(tick * 50_000_000, bytes(frame)) for tick, frame in enumerate(frames)]


def test_unsigned_numbers_of_64_bits_are_whole(tmp_path: Path) -> None:
    folder, path = make_run(tmp_path / "run", version), tmp_path / "run.mcap"
    scenario = read_scenario("separation")
    (folder / "scenario.yaml").write_text(scenario.to_yaml(), encoding="utf-8")
    write_mcap(folder, path, scenario.mcap.model_copy(update={"mavlink": "messages"}))
    topic = "/ua_0/mavlink/from_autopilot/AUTOPILOT_VERSION"
    assert [message.uid for message in read_mcap(path).messages[topic]] == UIDS
    with AnyReader([path]) as bag:
        topics = [each for each in bag.connections if each.topic == topic]
        assert [bag.deserialize(raw, each.msgtype).uid for each, _, raw in bag.messages(topics)] == UIDS


def test_a_directory_may_have_a_name_that_utf_8_has_not(tmp_path: Path) -> None:
    folder, path = make_run(tmp_path / "run", version), tmp_path / "run.mcap"
    scenario = read_scenario("separation")
    (folder / "scenario.yaml").write_text(scenario.to_yaml(), encoding="utf-8")
    other = folder.rename(tmp_path / os.fsdecode(b"r\xffn"))
    write_mcap(other, path, scenario.mcap)
    assert read_mcap(path).metadata["run"] == "r\ufffdn"
