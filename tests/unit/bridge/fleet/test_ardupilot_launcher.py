"""What real ArduPilot is started with."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest

from bridge.fleet.autopilots.ardupilot import ArduPilot
from bridge.fleet.autopilots.dirs import AutopilotDirs
from bridge.fleet.autopilots.launcher import AutopilotError, LaunchPlan
from bridge.fleet.children.child import Child, ProcessSpec, start_anew
from bridge.run.directory import RunDirectory
from bridge.scenario.file import SCENARIOS, ScenarioError, parse_scenario
from bridge.scenario.resolve.flight import airframe_of, home_of

TEXT = (SCENARIOS / "separation.yaml").read_text(encoding="utf-8")
WITH_PARAMETERS = TEXT.replace(
    "radio: hata-qpsk", "radio: moon2020\nparameters: {SIM_RATE_HZ: 400, FRAME_TYPE: 0}"
).replace(
    "home: {north_m: 5, east_m: 0}",
    "home: {north_m: 5, east_m: 0}\n    parameters: {SIM_RATE_HZ: 1000, WPNAV_SPEED: 0.125}",
)


def launched(tmp_path: Path, text: str, node: str) -> ProcessSpec:
    binary = tmp_path / "arducopter"
    binary.write_text("#!/bin/sh\n")
    binary.chmod(0o755)
    scenario = parse_scenario(text, "my.yaml")
    run = RunDirectory.create(tmp_path / "runs", scenario.name)
    ua = scenario.node(node)
    plan = LaunchPlan(run, scenario, ua, airframe_of(ua), home_of(ua, scenario.origin))
    (spec,) = ArduPilot({}, AutopilotDirs(ardupilot=tmp_path)).processes([plan])
    assert spec is not None
    return spec


def parameters_of(spec: ProcessSpec) -> dict[str, float]:
    """What the files after --defaults say, the last one winning, as in ArduPilot."""
    values: dict[str, float] = {}
    assert spec.cwd is not None
    for file in spec.command[spec.command.index("--defaults") + 1].split(","):
        text = (spec.cwd / file).read_text(encoding="utf-8")
        lines = (line.split("#")[0].split() for line in text.splitlines())
        values |= {name: float(value) for name, value in filter(None, lines)}
    return values


def test_parameters_of_the_ua_win_over_those_of_all_and_those_over_the_airframes(tmp_path: Path) -> None:
    first, second = (parameters_of(launched(tmp_path, WITH_PARAMETERS, node)) for node in ("0", "1"))
    assert (first["SIM_RATE_HZ"], first["FRAME_TYPE"], first["FRAME_CLASS"]) == (400, 0, 1)
    assert (second["SIM_RATE_HZ"], second["FRAME_TYPE"], second["WPNAV_SPEED"]) == (1000, 0, 0.125)
    without = parameters_of(launched(tmp_path, TEXT, "1"))
    assert (without["SIM_RATE_HZ"], without["FRAME_TYPE"]) == (800, 1)


def test_a_run_in_a_folder_with_a_comma_has_its_parameters(tmp_path: Path) -> None:
    folder = tmp_path / "wind, 8 m per s"
    folder.mkdir()
    assert parameters_of(launched(folder, WITH_PARAMETERS, "1"))["SIM_RATE_HZ"] == 1000


@pytest.mark.ardupilot
async def test_a_panic_of_the_real_arducopter_ends_it_and_is_what_its_log_ends_with(
    arducopter: Path, tmp_path: Path, free_slot: Callable[[int], int]
) -> None:
    spec = launched(tmp_path, f"{TEXT}ports: {{first_slot: {free_slot(2)}}}\n", "1")
    assert spec.cwd is not None
    (spec.cwd / "own.parm").unlink()
    child = Child(replace(spec, command=[str(arducopter), *spec.command[1:]]), start_anew)
    try:
        await asyncio.wait_for(asyncio.shield(child.ended), 60)
    finally:
        child.kill()
    assert child.how_it_ended == "ended with status 1"
    assert "PANIC: Failed to load defaults" in child.last_words()


def test_ports_move_and_what_sitl_says_of_itself_does_not(tmp_path: Path) -> None:
    """SITL adds `-I` to the first letter of the id in its banner, which a ground station asks for; see its Util.cpp."""

    def options(slot: int) -> dict[str, str]:
        words = launched(tmp_path, f"{TEXT}ports: {{first_slot: {slot}}}\n", "1").command
        assert words.index("-I") < min(
            words.index(word) for word in words if word.endswith(("port", "-in", "-out"))
        )
        return {word: value for word, value in pairwise(words) if word.startswith("-")}

    here, there = options(0), options(40)
    assert here["-I"] == there["-I"] == "1"
    ports = {"--base-port": 5770, "--rc-in-port": 5511, "--sim-port-in": 9013, "--sim-port-out": 9012}
    assert {name: int(here[name]) for name in ports} == ports
    assert {name: int(there[name]) - 400 for name in ports} == ports


@pytest.mark.parametrize(
    ("value", "key"),
    [
        ("{sim_rate: 1}", "parameters.sim_rate"),
        ("{SIM_RATE_HZ: fast}", "parameters.SIM_RATE_HZ"),
        ("5", "parameters"),
    ],
)
def test_mistake_is_told_with_its_place(value: str, key: str) -> None:
    with pytest.raises(ScenarioError, match=rf"my\.yaml:\d+: {key}"):
        parse_scenario(TEXT + f"parameters: {value}\n", "my.yaml")


@pytest.mark.parametrize(
    ("binary", "target", "end"),
    [("arducopter", "copter", "; or fly the stand-in (autopilot: standin)."), ("arduplane", "plane", ".")],
)
def test_a_missing_binary_is_told_with_what_builds_it(
    tmp_path: Path, binary: str, target: str, end: str
) -> None:
    """The stand-in flies multirotors only."""
    with pytest.raises(AutopilotError) as told:
        ArduPilot({"PATH": ""}, AutopilotDirs(ardupilot=tmp_path)).binary(binary)
    text = str(told.value)
    assert f"no ArduPilot binary '{binary}' was found" in text
    assert f"./waf {target})" in text
    assert text.endswith(f"--ardupilot-dir DIR or ARDUPILOT_HOME=DIR{end}")
