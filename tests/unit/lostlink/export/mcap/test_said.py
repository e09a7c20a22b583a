"""What agents logged, in the MCAP file: what was not logged is not there."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from rosbags.highlevel import AnyReader

from bridge.record import names
from bridge.record.logged import LoggedValue, Value, encode_logged
from bridge.record.streams import Entry
from bridge.scenario.file import read_scenario
from lostlink.export.mcap.export import write_mcap
from tests.unit.bridge.record.runs import RunContent, make_run
from tests.unit.lostlink.export.mcap.files import read_mcap

ALWAYS: dict[str, Any] = {"at": 7, "name": "a", "fine": True}
AT_TIMES: dict[str, Any] = {
    "count": 3,
    "why": "lost",
    "late": True,
    "gap_m": 1.5,
    "to_m": [1.0, 2.0],
    "said": "",
}
VALUES: list[Value] = [ALWAYS | AT_TIMES, ALWAYS, ALWAYS | AT_TIMES]


def log(made: RunContent) -> None:
    values = [LoggedValue("plan", value) for value in VALUES]
    entries = [Entry(tick * 50_000_000, encode_logged(value)) for tick, value in enumerate(values)]
    made.streams[names.logged("0")] = entries


def test_a_key_that_a_mapping_lacks_has_no_value_that_was_never_logged(tmp_path: Path) -> None:
    folder, path = make_run(tmp_path / "run", log), tmp_path / "run.mcap"
    scenario = read_scenario("separation")
    (folder / "scenario.yaml").write_text(scenario.to_yaml(), encoding="utf-8")
    write_mcap(folder, path, scenario.mcap)
    with AnyReader([path]) as bag:
        topics = [each for each in bag.connections if each.topic == "/ua_0/log/plan"]
        of_rosbags: list[Any] = [bag.deserialize(raw, each.msgtype) for each, _, raw in bag.messages(topics)]
    for messages in (read_mcap(path).messages["/ua_0/log/plan"], of_rosbags):
        assert len(messages) == 3
        for message in messages:
            assert (message.at, message.name, message.fine) == (7, "a", True)
        for has in (messages[0], messages[2]):
            assert (has.count, has.late, has.gap_m, list(has.to_m)) == (3.0, 1.0, 1.5, [1.0, 2.0])
            assert (list(has.why), list(has.said)) == (["lost"], [""])
        lacks: Any = messages[1]
        assert all(math.isnan(value) for value in (lacks.count, lacks.late, lacks.gap_m))
        assert (len(lacks.to_m), len(lacks.why), len(lacks.said)) == (0, 0, 0)
