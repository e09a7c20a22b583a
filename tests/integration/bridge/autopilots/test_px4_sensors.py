"""Sensors of a UA that PX4 flies, from the scenario file to its simulator interface. A script takes PX4's place."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import common

from tests.integration.bridge.conftest import STILL, StartRun
from tests.px4_played import KEPT, build

ROOT = Path(__file__).parents[4]
SENSORS = """\
fdm:
  px4: {{imu_rate_hz: 200, gps_rate_hz: 4, pressure_rate_hz: 20, magnetometer_rate_hz: 40, truth_rate_hz: 10,
    gyro_sigma_radps: 0.1, gps_vertical_sigma_m: 0.0, pressure_sigma_pa: 0.0}}
"""


@pytest.mark.slow
def test_rates_and_errors_of_sensors_are_those_of_the_scenario(tmp_path: Path, start_run: StartRun) -> None:
    play = f"PYTHONPATH={ROOT} exec {sys.executable} -m tests.px4_played $((4560 + $2)) 3 1000000 keeps"
    place = build(tmp_path / "px4", play)
    scenario = STILL.replace("radio:", SENSORS + "radio:")
    run = start_run("--autopilot", "px4", "--px4-dir", str(place), scenario=scenario, duration_s=3.0)
    assert run.finish() == 0, run.output.decode()
    (kept,) = run.directory.glob(f"autopilot-0/**/{KEPT}")
    messages = common.MAVLink(None).parse_buffer(kept.read_bytes())
    sensors = [each for each in messages if each.get_type() == "HIL_SENSOR"]
    assert set(np.diff([each.time_usec for each in sensors])) == {5_000}
    by_pressure = [each for each in sensors if each.fields_updated & 1 << 9]
    by_field = [each for each in sensors if each.fields_updated & 1 << 6]
    fixes = [each for each in messages if each.get_type() == "HIL_GPS"]
    truths = [each for each in messages if each.get_type() == "HIL_STATE_QUATERNION"]
    for step_us, rows in ((50_000, by_pressure), (25_000, by_field), (250_000, fixes), (100_000, truths)):
        assert set(np.diff([each.time_usec for each in rows])) == {step_us}
    assert len(fixes) >= 10
    gyro = np.array([(each.xgyro, each.ygyro, each.zgyro) for each in sensors])
    assert gyro.std() == pytest.approx(0.1, rel=0.1)  # 1800 draws: 1.7 %
    assert abs(np.corrcoef(gyro[:-1, 0], gyro[1:, 0])[0, 1]) < 0.2
    assert len({each.alt for each in fixes}) == 1, "it stands, and its height has no error"
    assert len({each.abs_pressure for each in by_pressure}) == 1
