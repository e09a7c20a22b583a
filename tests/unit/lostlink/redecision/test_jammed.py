"""A jammer in the radios of several nodes and networks, from scenario to record."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bridge.record.tables.deliveries import DELIVERIES
from bridge.record.tables.reader import read_columns
from bridge.scenario.file import parse_scenario
from lostlink.redecision.redecide import redecide
from tests.unit.lostlink.replay.flown import Sent, flown

SCENARIO = """\
schema: 1
name: jammed
duration_s: 600
origin: {lat_deg: 40.0, lon_deg: -105.0, alt_amsl_m: 1600.0}
radio: &plain {preset: corrected, shadowing: {model: none}, fading: {model: none}}
networks: {mesh: {<<: *plain, frequency_hz: 2.45e+9, interference: {interferers: [HIDDEN, ONE]}}}
nodes:
  - {id: 0, radio: {<<: *plain, interference: {interferers: [ONE]}}, agent: {type: still}}
  - {id: 1, radio: {<<: *plain, interference: {interferers: [TWO]}}, agent: {type: still}}
  - {id: 2, radio: {<<: *plain, interference: {interferers: [HIDDEN, ONE]}}, agent: {type: still}}
  - {id: 3, agent: {type: still}}
"""
IN_RUN = {
    "ONE": "{name: one, position_ned_m: [0, 50, -10], power_dbm: 45, duty: 0.5, slot_s: 0.05}",
    "TWO": "{name: two, position_ned_m: [0, 50, -10], power_dbm: 45, duty: 0.5, slot_s: 0.05}",
    "HIDDEN": "{name: hidden, position_ned_m: [0, 0, 0], power_dbm: -100, duty: 0.5, slot_s: 0.05}",
}


@pytest.mark.slow
def test_in_the_record_of_a_run_a_jammer_jams_all_that_list_it_at_once(tmp_path: Path) -> None:
    text = SCENARIO
    for name, interferer in IN_RUN.items():
        text = text.replace(name, interferer)
    ticks = 400
    run = flown(
        tmp_path / "run",
        parse_scenario(text, "jammed.yaml"),
        ticks,
        lambda _: [Sent("3"), Sent("3", radio="mesh")],
        scale=0.1,
    )
    rows = read_columns(run, DELIVERIES)
    noise = rows["received_power_dbm"] - rows["snr_db"]
    on = {
        (radio, rx): noise[(rows["radio"] == radio) & (rows["rx"] == rx)] > -80.0
        for radio in ("main", "mesh")
        for rx in "012"
    }
    assert {slots.size for slots in on.values()} == {ticks}
    one = on["main", "0"]
    assert abs(int(one.sum()) - ticks / 2) < 3.29 * np.sqrt(ticks / 4)
    assert [way for way, slots in on.items() if (slots != one).any()] == [("main", "1")]
    agree = int((one == on["main", "1"]).sum())
    assert abs(agree - ticks / 2) < 3.29 * np.sqrt(ticks / 4)
    assert redecide(run).comparison.is_same
