"""What real PX4 is started with; its shell takes whole numbers by strtol, which ends at the first other character."""

from __future__ import annotations

import json
import lzma
import re
import signal
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from shutil import copytree

import pytest

from bridge.fleet.autopilots.dirs import AutopilotDirs
from bridge.fleet.autopilots.launch_standin import StandIn
from bridge.fleet.autopilots.launcher import AutopilotError, LaunchPlan
from bridge.fleet.autopilots.launchers import Launchers
from bridge.fleet.autopilots.px4 import Px4
from bridge.fleet.children.child import ProcessSpec
from bridge.run.directory import RunDirectory
from bridge.scenario.file import SCENARIOS, parse_scenario
from bridge.scenario.model import Scenario
from bridge.scenario.resolve.flight import airframe_of, home_of

STANDIN = (SCENARIOS / "separation.yaml").read_text(encoding="utf-8")
SEPARATION = STANDIN.replace("autopilot: standin", "autopilot: px4")


def scenario_of(text: str = "") -> Scenario:
    return parse_scenario(SEPARATION + text, "my.yaml")


def launched(home: Path, runs: Path, scenario: Scenario, node: str = "0") -> ProcessSpec:
    run = RunDirectory.create(runs, scenario.name)
    ua = scenario.node(node)
    plan = LaunchPlan(run, scenario, ua, airframe_of(ua), home_of(ua, scenario.origin))
    (spec,) = Px4({"PX4_HOME": str(home), "PATH": "/nowhere"}).processes([plan])
    return spec


def parameters_of(spec: ProcessSpec) -> dict[str, str]:
    """What is set, the last one winning; in the script of older versions and in the environment for newer ones."""
    assert spec.cwd is not None
    lines = (spec.cwd / "px4-rc.params").read_text(encoding="ascii").splitlines()
    values = {name: text for _, _, name, text in map(str.split, lines)}
    prefix = "PX4_PARAM_"
    given = {
        name.removeprefix(prefix): text for name, text in spec.environment.items() if name.startswith(prefix)
    }
    assert given == values
    return values


def strtol(text: str) -> int:
    """C's, base 10."""
    found = re.match(r"[+-]?[0-9]+", text)
    return int(found[0]) if found else 0


@pytest.mark.parametrize("value", [0, 1, -1, 10**9, 123456789, 2**31 - 1, -(2**31)])
def test_px4_reads_whole_numbers_as_they_are(tmp_path: Path, px4_home: Path, value: int) -> None:
    spec = launched(px4_home, tmp_path, scenario_of(f"parameters: {{SDLOG_UTC_OFFSET: {value}}}\n"))
    assert strtol(parameters_of(spec)["SDLOG_UTC_OFFSET"]) == value


def test_parameters_of_the_ua_win_over_those_of_all_and_those_over_the_airframes(
    tmp_path: Path, px4_home: Path
) -> None:
    text = SEPARATION.replace(
        "home: {north_m: 5, east_m: 0}",
        "home: {north_m: 5, east_m: 0}\n    parameters: {MPC_THR_HOVER: 0.125}",
    )
    scenario = parse_scenario(text + "parameters: {MPC_THR_HOVER: 0.1, NAV_DLL_ACT: 2}\n", "my.yaml")
    first, second = (parameters_of(launched(px4_home, tmp_path, scenario, node)) for node in ("0", "1"))
    names = ("MAV_SYS_ID", "MPC_THR_HOVER", "NAV_DLL_ACT", "CA_ROTOR_COUNT", "CA_ROTOR0_PX")
    assert [first[name] for name in names] == ["1", "0.1", "2", "4", "0.1651"]
    assert [second[name] for name in names] == ["2", "0.125", "2", "4", "0.1651"]


def test_one_link_leads_to_the_daemon_of_the_ua(tmp_path: Path, px4_home: Path) -> None:
    spec = launched(px4_home, tmp_path, scenario_of("ports: {first_slot: 30}\n"), "1")
    assert spec.cwd is not None
    start, *rest = (spec.cwd / "px4-rc.mavlink").read_text(encoding="ascii").splitlines()
    assert start.split()[:7] == ["mavlink", "start", "-x", "-u", "6070", "-o", "6071"]  # 5760 + 10 (30 + 1)
    assert "-t 127.0.0.1" in start
    assert rest == ["mavlink stream -r 0 -s SYSTEM_TIME -u 6070", "load_mon stop"]


def test_its_start_script_finds_what_it_runs(tmp_path: Path, px4_home: Path) -> None:
    build = px4_home / "build" / "px4_sitl_default"
    spec = launched(px4_home, tmp_path, scenario_of("ports: {first_slot: 30}\n"), "1")
    assert spec.command[:5] == [str(build / "bin" / "px4"), "-i", "31", "-d", str(build / "etc")]
    assert spec.environment["PX4_SYS_AUTOSTART"] == "10016"
    assert spec.environment["PATH"].split(":") == [str(spec.cwd), "/nowhere"]
    assert spec.stop_signal == signal.SIGKILL


def test_an_instance_beyond_its_ports_is_refused(px4_home: Path) -> None:
    scenario = scenario_of("ports: {first_slot: 249}\n")
    launcher = Px4({"PX4_HOME": str(px4_home)})
    launcher.check(scenario, scenario.ua[0])
    with pytest.raises(AutopilotError, match=r"UA 1 would be PX4's instance 250.*--first-slot"):
        launcher.check(scenario, scenario.ua[1])


def with_airframe(folder: Path, changed: Callable[[str], str]) -> Scenario:
    """UA 0 has an f450 whose file is changed."""
    file = folder / "own.yaml"
    airframes = SCENARIOS.parent / "airframes"
    copytree(airframes / "jsbsim", folder / "jsbsim")
    file.write_text(changed((airframes / "f450.yaml").read_text(encoding="utf-8")), encoding="utf-8")
    return parse_scenario(SEPARATION.replace("airframe: f450", f"airframe: {file}", 1), "my.yaml")


def test_an_airframe_that_px4_does_not_know_is_refused(tmp_path: Path, px4_home: Path) -> None:
    scenario = with_airframe(tmp_path, lambda shipped: shipped[: shipped.index("px4:")])
    with pytest.raises(AutopilotError, match="has no section px4"):
        Px4({"PX4_HOME": str(px4_home)}).check(scenario, scenario.ua[0])


def test_a_fraction_for_what_px4_has_as_a_whole_number_is_refused(tmp_path: Path, px4_home: Path) -> None:
    """Its shell would take GF_ACTION 2.5 for 2 without a word."""
    kinds = {"GF_ACTION": "Int32", "CA_ROTOR_COUNT": "Int32", "MPC_XY_CRUISE": "Float"}
    listed = [{"name": name, "type": kind} for name, kind in kinds.items()]
    extras = px4_home / "build" / "px4_sitl_default" / "etc" / "extras"
    (extras / "parameters.json.xz").write_bytes(lzma.compress(json.dumps({"parameters": listed}).encode()))
    px4 = Px4({"PX4_HOME": str(px4_home)})
    for values, reason in (
        ("GF_ACTION: 2", ""),
        ("MPC_XY_CRUISE: 2.5", ""),
        ("GF_ACTION: 2.5", "would be 2"),
    ):
        scenario = scenario_of(f"parameters: {{{values}}}\n")
        with pytest.raises(AutopilotError, match=reason) if reason else nullcontext():
            px4.check(scenario, scenario.ua[0])
    own = with_airframe(tmp_path, lambda shipped: shipped.replace("CA_ROTOR_COUNT: 4", "CA_ROTOR_COUNT: 4.5"))
    with pytest.raises(AutopilotError, match=r"CA_ROTOR_COUNT is 4\.5"):
        px4.check(own, own.ua[0])


def test_without_a_px4_the_places_are_told() -> None:
    with pytest.raises(AutopilotError, match=r"/nowhere/else/bin/px4\n(.|\n)*--px4-dir DIR"):
        Px4({"PX4_HOME": "/nowhere/else", "PATH": "/nowhere"}).binary()


def test_the_ua_of_a_mixed_fleet_have_the_sources_of_their_autopilots(px4_home: Path) -> None:
    text = STANDIN.replace("airframe: f450", "airframe: f450\n    autopilot: px4", 1)
    scenario = parse_scenario(text, "my.yaml")
    launchers = Launchers(scenario, {}, AutopilotDirs(px4=px4_home))
    assert [type(launchers.of(ua)) for ua in scenario.ua] == [Px4, StandIn]
    assert launchers.of(scenario.ua[0]).origin(scenario.ua[0]).path.endswith("px4_sitl_default/bin/px4")
    started = [launchers.each(waits_for_physics=waits) for waits in (True, False)]
    found = {type(launcher): [ua.node for ua in fleet] for each in started for launcher, fleet in each}
    assert found == {Px4: ["0"], StandIn: ["1"]}
