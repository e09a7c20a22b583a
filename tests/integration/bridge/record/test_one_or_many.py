"""The same scenario gives the same digests whether its parts are called in one process or joined by Zenoh in many."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from bridge.bus.messages import DataPackage, encoding_of
from bridge.record import names
from bridge.record.packets import packets_of
from bridge.record.streams import entries_of
from bridge.record.tables.deliveries import DELIVERIES
from bridge.record.tables.reader import read_columns
from tests.warm import run_lostlink

ROOT = Path(__file__).parents[4]
EXAMPLES = ROOT / "examples"
MODEMS = ROOT / "tests" / "data" / "modems.yaml"
NOISY = ("--set", "wind=gusty", "--set", "fdm.sensor_noise={gyro_sigma_radps: 0.002, accel_sigma_mps2: 0.05}")
AHEAD = ("--set", "lookahead_ticks=1")
FLOWN = {
    "separation": ("separation",),
    "turbulence, noise, exchanges": ("separation", *NOISY, "--set", "mavlink_rate_hz=100"),
    "parallel coupling": ("separation", "--set", "fdm.coupling=parallel"),
    "a partition, modems": (
        str(MODEMS),
        "--set",
        "partitions=[{groups: [[0], [1, gcs]], from_s: 1, to_s: 2}]",
    ),
    "outages": ("separation", "--radio", "wifi-2.4", "--set", "nodes.1.radio_off=[{from_s: 2, to_s: 4}]"),
    "localise": (str(EXAMPLES / "localise" / "localise.yaml"),),
    "wander": (str(EXAMPLES / "agents" / "wander.yaml"),),
    "turn back": (str(EXAMPLES / "agents" / "turn_back.yaml"),),
    "relay placement": (str(EXAMPLES / "relay_placement" / "relay_placement.yaml"),),
    "consensus": (str(EXAMPLES / "consensus" / "consensus.yaml"),),
    "a ground station": (str(EXAMPLES / "ground_nodes" / "ground_station.yaml"),),
    "lookahead": ("separation", *NOISY, *AHEAD),
    "lookahead, exchanges": (
        str(EXAMPLES / "agents" / "wander.yaml"),
        *AHEAD,
        "--set",
        "mavlink_rate_hz=100",
    ),
    "modems": (str(MODEMS),),
    "modems, exchanges, lookahead": (str(MODEMS), *AHEAD, "--set", "mavlink_rate_hz=100"),
    "many UA": (str(EXAMPLES / "scenarios" / "ring.yaml"),),
}
SHORT = {"separation"}
LONG = {"modems", "consensus", "localise", "turn back", "lookahead, exchanges", "parallel coupling"}
"""What others are short of, or fly in a test of their own."""
MARKS = {**dict.fromkeys(LONG, pytest.mark.long), **dict.fromkeys(SHORT, ())}


def fly(
    tmp_path: Path, slot: int, processes: str, *arguments: str, duration_s: float = 8.0
) -> dict[str, Any]:
    """The summary of a run."""
    command = ["run", *arguments, "--json", "--duration", str(duration_s), "--speed", "max"]
    command += ["--processes", processes, "--out", str(tmp_path / processes), "--no-figure", "--no-mcap"]
    command += ["--set", "ports.zenoh=0", "--first-slot", str(slot)]
    done = run_lostlink(*command, cwd=ROOT, timeout=300)
    assert done.stdout, done.stderr
    summary: dict[str, Any] = json.loads(done.stdout)
    assert summary["ending"] in ("done", "duration"), summary["error"]
    return summary


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=MARKS.get(name, pytest.mark.slow)) for name in FLOWN]
)
def test_the_digests_are_equal(name: str, tmp_path: Path, free_slot: Callable[[int], int]) -> None:
    slot = free_slot(24)
    duration_s = 4.0
    one, many = (fly(tmp_path, slot, kind, *FLOWN[name], duration_s=duration_s) for kind in ("one", "many"))
    assert one["digests"] == many["digests"]
    assert one["links"] == many["links"]
    assert one["sim_duration_s"] == many["sim_duration_s"]
    assert (one["may_not_repeat"], many["may_not_repeat"]) == ([], [])
    assert one["refused"] == many["refused"]


@pytest.mark.parametrize("processes", ["one", pytest.param("many", marks=pytest.mark.slow)])
def test_what_is_said_of_a_payload_is_recorded(
    processes: str, tmp_path: Path, free_slot: Callable[[int], int]
) -> None:
    """Of a message its type, of bytes nothing, however they came to the radio."""
    wander = str(EXAMPLES / "agents" / "wander.yaml")
    fly(tmp_path, free_slot(4), processes, wander, "--set", "fdm.standin_rate_hz=100", duration_s=1.0)
    (run,) = (tmp_path / processes).iterdir()
    said = {(packet.channel, packet.encoding) for _, packet in packets_of(run, "0")}
    assert said == {("team", encoding_of(DataPackage)), ("beacon", ""), ("heard", "")}
    rows = read_columns(run, DELIVERIES, ("channel", "encoding", "sim_time_ns", "received_ns"))
    assert set(zip(rows["channel"], rows["encoding"], strict=True)) == said
    assert set((rows["received_ns"] - rows["sim_time_ns"]).tolist()) == {50_000_000}


@pytest.mark.slow
def test_what_is_decided_ahead_takes_effect_a_tick_later(
    tmp_path: Path, free_slot: Callable[[int], int]
) -> None:
    """Bytes for the autopilot are written at the tick after the one at which they were decided."""
    slot = free_slot(4)
    first_ns = []
    for name, more in (("now", ()), ("ahead", AHEAD)):
        fly(tmp_path / name, slot, "one", "separation", *more, duration_s=2.0)
        (run,) = (tmp_path / name / "one").iterdir()
        first_ns.append(next(at for at, _ in entries_of(names.to_autopilot("0").path(run))))
    assert first_ns == [0, 50_000_000]


def test_one_process_is_one(tmp_path: Path, free_slot: Callable[[int], int]) -> None:
    """No router, no port of ours, no log of a process that is not there."""
    summary = fly(tmp_path, free_slot(2), "one", "separation", duration_s=2.0)
    (run,) = (tmp_path / "one").iterdir()
    assert sorted(path.name for path in (run / "logs").iterdir()) == ["fleet.log", "node-0.log", "node-1.log"]
    assert json.loads((run / "run.json").read_text())["endpoint"] == ""
    assert not (run / "secrets").exists()
    assert summary["counters"]["physics"]["ua 0 frames"] > 0


@pytest.mark.slow
def test_forked_from_the_command_or_started_anew_it_is_the_same_run(
    tmp_path: Path, free_slot: Callable[[int], int], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The program is forked where the command may begin again in the environment of a run."""
    slot = free_slot(2)
    forked = fly(tmp_path / "forked", slot, "one", "separation", *NOISY, duration_s=2.0)
    monkeypatch.setenv("PYTHONHASHSEED", "1")
    anew = fly(tmp_path / "anew", slot, "one", "separation", *NOISY, duration_s=2.0)
    assert forked["digest"] == anew["digest"]


@pytest.mark.parametrize(
    "setting",
    ["hosts=2", "fdm.workers=2", "nodes.0.agent.isolated=true"],
    ids=lambda text: text.split("=")[0],
)
def test_what_asks_for_processes_gets_them_or_is_told(setting: str, tmp_path: Path) -> None:
    command = ["check", "separation", "--set", setting, "--set", "processes=one"]
    done = run_lostlink(*command, timeout=60)
    assert done.returncode == 2
    assert "processes: one, and" in done.stderr


@pytest.mark.skipif("ARDUPILOT_HOME" not in os.environ, reason="needs ARDUPILOT_HOME")
@pytest.mark.ardupilot
@pytest.mark.slow
@pytest.mark.parametrize("ahead", [(), AHEAD], ids=["at once", "lookahead"])
@pytest.mark.parametrize(
    "scenario", ["separation", "mixed", str(EXAMPLES / "localise" / "localise_wings.yaml")]
)
def test_real_autopilots_fly_the_same(
    scenario: str, ahead: tuple[str, ...], tmp_path: Path, free_slot: Callable[[int], int]
) -> None:
    slot = free_slot(4)
    arguments = (scenario, "--autopilot", "ardupilot", *ahead)
    one, many = (fly(tmp_path, slot, processes, *arguments, duration_s=25.0) for processes in ("one", "many"))
    assert one["digests"] == many["digests"]
    assert (one["may_not_repeat"], many["may_not_repeat"]) == ([], [])
