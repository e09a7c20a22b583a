"""What real PX4 is started with, and what is said where it cannot be."""

from __future__ import annotations

import signal
from pathlib import Path

import pytest

from bridge.fleet.autopilots.launcher import AutopilotError, LaunchPlan
from bridge.fleet.autopilots.px4 import Px4
from bridge.run.directory import RunDirectory
from bridge.scenario.file import SCENARIOS, parse_scenario
from bridge.scenario.model import Scenario
from bridge.scenario.nodes import Aircraft
from bridge.scenario.resolve.flight import airframe_of, home_of

TEXT = (
    (SCENARIOS / "separation.yaml")
    .read_text(encoding="utf-8")
    .replace("autopilot: standin", "autopilot: px4")
    .replace("radio: hata-qpsk", "radio: moon2020\nparameters: {MPC_XY_CRUISE: 7, MPC_THR_HOVER: 0.5}")
    .replace(
        "home: {north_m: 5, east_m: 0}", "home: {north_m: 5, east_m: 0}\n    parameters: {MPC_XY_CRUISE: 4.5}"
    )
)


@pytest.fixture
def build(tmp_path: Path) -> Path:
    """What of PX4's build is looked for."""
    binary = tmp_path / "build" / "bin" / "px4"
    binary.parent.mkdir(parents=True)
    binary.write_text("#!/bin/sh\n")
    binary.chmod(0o755)
    (tmp_path / "build" / "etc" / "init.d-posix").mkdir(parents=True)
    return tmp_path / "build"


def scenario_and_ua(node: str, text: str = TEXT) -> tuple[Scenario, Aircraft]:
    scenario = parse_scenario(text, "my.yaml")
    ua = scenario.node(node)
    assert isinstance(ua, Aircraft)
    return scenario, ua


def test_it_starts_in_a_directory_of_its_own_with_its_own_instance_and_parameters(
    build: Path, tmp_path: Path
) -> None:
    scenario, ua = scenario_and_ua("1")
    run = RunDirectory.create(tmp_path / "runs", scenario.name)
    plan = LaunchPlan(run, scenario, ua, airframe_of(ua), home_of(ua, scenario.origin))
    launcher = Px4({"PX4_HOME": str(build), "PATH": "/bin"})
    launcher.check(scenario, ua)
    (spec,) = launcher.processes([plan])
    own = run.path / "autopilot-1"
    assert spec.cwd == own
    assert spec.command[:3] == [str(build / "bin" / "px4"), "-i", "1"]
    assert spec.environment["PATH"] == f"{own}:/bin", "its start script finds our hooks first"
    assert spec.stop_signal == signal.SIGKILL
    values: dict[str, float] = {}
    for line in (own / "px4-rc.params").read_text(encoding="ascii").splitlines():
        param, verb, name, value = line.split()
        assert (param, verb) == ("param", "set")
        values[name] = float(value)
    assert (values["MPC_XY_CRUISE"], values["MPC_THR_HOVER"]) == (4.5, 0.5), "UA over fleet over airframe"
    assert values["MAV_SYS_ID"] == ua.sysid
    assert "-u 5770 -o 5771" in (own / "px4-rc.mavlink").read_text(encoding="ascii")


def test_where_there_is_none_the_places_are_named(tmp_path: Path) -> None:
    scenario, ua = scenario_and_ua("0")
    with pytest.raises(AutopilotError, match="no PX4 was found") as raised:
        Px4({"PX4_HOME": str(tmp_path), "PATH": ""}).check(scenario, ua)
    assert str(tmp_path / "build" / "px4_sitl_default" / "bin" / "px4") in str(raised.value)


def test_instances_whose_ports_are_those_of_others_are_refused(build: Path) -> None:
    scenario, ua = scenario_and_ua("1", TEXT + "\nports: {first_slot: 249}\n")
    with pytest.raises(AutopilotError, match="beyond 249"):
        Px4({"PX4_HOME": str(build)}).check(scenario, ua)
