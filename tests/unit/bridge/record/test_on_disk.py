"""How far the record of a run that goes on can be read: as far as the part that wrote least of it."""

from __future__ import annotations

from pathlib import Path

from bridge.record.on_disk import PHYSICS, RADIO, note_on_disk, on_disk_before_ns, part_of
from bridge.run.directory import RunDirectory
from bridge.scenario.file import parse_scenario

FREE = """
schema: 1
name: free
duration_s: 1
origin: {lat_deg: 40.1331, lon_deg: -105.2404, alt_amsl_m: 1690}
radio: perfect
nodes:
  - {id: probe, kind: ground, agent: {type: free}}
  - {id: beacon, kind: emitter, frequency_hz: 433.92e+6, power_dbm: 20}
  - {id: 0, agent: {type: still}}
  - {id: gcs, kind: ground, agent: {type: still}}
"""


def test_all_is_on_disk_up_to_where_the_last_part_is(tmp_path: Path) -> None:
    run, scenario = RunDirectory(tmp_path), parse_scenario(FREE, "free")
    with run.going_on():
        assert on_disk_before_ns(tmp_path, scenario) == 0
        for part, before_ns in ((PHYSICS, 9), (RADIO, 8), (part_of(scenario, "0"), 1 << 62)):
            note_on_disk(tmp_path, part, before_ns)
            assert on_disk_before_ns(tmp_path, scenario) == 0
        note_on_disk(tmp_path, part_of(scenario, "gcs"), 7)
        assert on_disk_before_ns(tmp_path, scenario) == 7, (
            "nobody of ours writes of a free node, or of an emitter"
        )
        note_on_disk(tmp_path, part_of(scenario, "gcs"), 100)
        assert on_disk_before_ns(tmp_path, scenario) == 8


def test_where_no_run_goes_on_nothing_is_noted(tmp_path: Path) -> None:
    note_on_disk(tmp_path, PHYSICS, 5)
    assert not list(tmp_path.iterdir())
    assert on_disk_before_ns(tmp_path, parse_scenario(FREE, "free")) == 0
