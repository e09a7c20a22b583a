"""The length that stands for all packets of a run."""

from __future__ import annotations

from pathlib import Path

import pytest

from channel.link.radio import Radio
from channel.presets import load_radio
from lostlink.reading.lengths import median_payload_bytes, recorded_payload_bytes
from tests.unit.lostlink.replay.flown import everybody, flown, scenario_of

NODES = ("0", "1")


@pytest.mark.parametrize(
    ("packets", "payload_bytes"),
    [({}, None), ({164: 1}, 100), ({164: 3, 264: 4}, 200), ({164: 4, 264: 3, 1064: 1}, 100), ({3: 1}, 0)],
)
def test_half_of_the_packets_are_as_long_at_most(packets: dict[int, int], payload_bytes: int | None) -> None:
    assert median_payload_bytes(Radio(load_radio("wifi-2.4")), packets) == payload_bytes


def test_it_is_read_from_a_record(tmp_path: Path) -> None:
    scenario = scenario_of("wifi-2.4", NODES)
    run = flown(tmp_path / "run", scenario, 20, everybody(NODES, 300))
    assert recorded_payload_bytes(run, scenario, Radio(load_radio("wifi-2.4"))) == 300
    assert recorded_payload_bytes(tmp_path / "none", scenario, Radio(load_radio("wifi-2.4"))) is None
