"""Programs of others on one vehicle each: MAVSDK, pymavlink's helpers, dronekit.

The scripts are those of examples/clients; what they print is what they saw.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.interop.served import CLIENTS, PARAMETERS_AT_LEAST, Served, distances_m, program, waypoint_file

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]


def number_after(lines: list[str], start: str) -> int:
    (found,) = (match for line in lines if (match := re.search(rf"{start}\D*(\d+)", line)))
    return int(found[1])


async def test_mavsdk_flies(served: Served) -> None:
    flags = ["--fixed-wing"] if served.is_plane else []
    home = served.daemon.state
    async with program(CLIENTS / "mavsdk_flight.py", served.mavsdk, *flags) as client:
        await client.says("north: ")
        state = served.daemon.state
        (flown_m,) = distances_m([(state.lat_deg, state.lon_deg)], home.lat_deg, home.lon_deg)
        assert flown_m > (200.0 if served.is_plane else 30.0)
        lines = await client.ends_well()
    text = "\n".join(lines)
    assert f"system: 4 {'FIXED_WING' if served.is_plane else 'MULTICOPTER'}" in text
    assert number_after(lines, "parameters:") >= PARAMETERS_AT_LEAST[served.kind]
    assert "health: global position True home True" in text
    assert "hold: HOLD" in text
    if not served.is_plane:
        assert "offboard: 3 m/s east" in text
        assert "offboard stopped, mode HOLD" in text
        assert not served.daemon.state.armed
        state = served.daemon.state
        assert distances_m([(state.lat_deg, state.lon_deg)], home.lat_deg, home.lon_deg)[0] < 2.0


@pytest.mark.parametrize("plugin", ["mission", "mission_raw"])
async def test_mavsdk_flies_a_mission_to_its_end(served: Served, plugin: str) -> None:
    if served.is_plane and plugin == "mission":
        pytest.skip("MAVSDK's plugin has no take-off that ArduPlane takes")
    flags = (["--raw"] if plugin == "mission_raw" else []) + (["--fixed-wing"] if served.is_plane else [])
    modes: list[str] = []
    served.daemon.subscribe(lambda state: modes.append(state.mode) if state.mode not in modes[-1:] else None)
    async with program(CLIENTS / "mavsdk_mission.py", served.mavsdk, *flags) as client:
        lines = await client.ends_well()
    paused = modes.index("AUTO") + 1
    assert modes[paused : paused + 2] == ["LOITER" if served.is_plane else "BRAKE", "AUTO"]
    text = "\n".join(lines)
    assert "fence: 4 corners" in text
    assert "paused: HOLD" in text
    total = {"mission": 3, "mission_raw": 5 if served.is_plane else 6}[plugin]
    done = [int(found[1]) for line in lines if (found := re.search(rf"mission: (\d) of {total}", line))]
    assert done == sorted(done)
    assert done[-1] == total
    if plugin == "mission":
        assert "finished: True" in text
    else:
        assert f"uploaded: {total} items" in text
    assert "mode: RETURN_TO_LAUNCH" in text


async def test_pymavlink_helpers(served: Served, tmp_path: Path) -> None:
    file = waypoint_file(served, tmp_path)
    if not served.is_plane:  # as a flight before left it
        await served.daemon.commands.run("mode", "RTL")
    async with program(CLIENTS / "pymavlink_mission.py", served.tcp, file) as client:
        lines = await client.ends_well()
    assert "system: 4" in lines
    assert number_after(lines, "parameters:") >= PARAMETERS_AT_LEAST[served.kind]
    name, before, after = "RTL_RADIUS", 80, 90
    if not served.is_plane:
        name, before, after = "WPNAV_RADIUS", 200, 210
    assert f"{name}: {before}, then {after}" in lines
    assert "accepted: True" in lines
    assert "downloaded: 4 the same: True" in lines
    assert f"armed in {'FBWA' if served.is_plane else 'GUIDED'}" in lines
    assert lines[-3:] == ["reached item 1", "reached item 2", "mode: RTL"]
    result = await served.daemon.commands.run("parameter_get", name)
    assert result.value == after


async def test_dronekit_flies(served: Served) -> None:
    if served.is_plane:
        pytest.skip("dronekit's simple_takeoff is for copters")
    home = served.daemon.state
    async with program(CLIENTS / "dronekit_flight.py", served.tcp) as client:
        await client.says("north: ")
        state = served.daemon.state
        assert 25.0 < distances_m([(state.lat_deg, state.lon_deg)], home.lat_deg, home.lon_deg)[0] < 32.0
        lines = await client.ends_well()
    text = "\n".join(lines)
    assert "system: 4 APM:Copter-4." in text
    assert number_after(lines, "parameters:") >= PARAMETERS_AT_LEAST[served.kind]
    assert "mission: 5 items" in text
    assert lines[-1] == "landed and disarmed"
    assert not served.daemon.state.armed
