"""MAVProxy on a real PX4 behind the daemon, as a child that takes its commands line by line."""

import asyncio

import pytest

from tests.interop.px4.px4_vehicle import copter_with_daemon
from tests.interop.served import Served, distances_m, mavproxy, places_of_tlog

pytestmark = [pytest.mark.px4, pytest.mark.slow, pytest.mark.timeout(300)]

AWAY_DEG = 0.0002
MISSION, RTL = "157 4 4", "157 4 5"
"""Base mode and PX4's main and sub mode. MAVProxy's own `mode NAME` ends with an error on any PX4."""


@pytest.fixture
async def served(tmp_path):
    """A daemon on a PX4 that is ready to arm."""
    async with copter_with_daemon(tmp_path) as daemon:
        yield Served("px4", daemon)


def mission_file(served, file):
    """A take-off and a waypoint, as PX4 takes missions: without a home in front."""
    state = served.daemon.state
    rows = [(22, state.lat_deg, 10.0), (16, state.lat_deg + AWAY_DEG, 10.0)]
    lines = [
        f"{seq}\t{int(seq == 0)}\t3\t{command}\t0\t0\t0\t0\t{lat_deg:.8f}\t{state.lon_deg:.8f}\t{height_m}\t1"
        for seq, (command, lat_deg, height_m) in enumerate(rows)
    ]
    file.write_text("\n".join(["QGC WPL 110", *lines]) + "\n")


async def test_mavproxy_flies_px4_through_the_daemon(served, tmp_path):
    commands, home = served.daemon.commands, served.daemon.state
    mission_file(served, tmp_path / "mission.txt")
    async with mavproxy(served, tmp_path) as client:
        await client.says(f"online system {served.daemon.config.sysid}")
        told = int((await client.says(r"Received (\d+) parameters"))[1])
        assert told == len((await commands.run("parameters")).value)
        client.types("param set MPC_XY_CRUISE 4")
        async with asyncio.timeout(20.0):
            while (await commands.run("parameter_get", "MPC_XY_CRUISE")).value != 4.0:
                pass
        fetched = 0.0
        async with asyncio.timeout(
            60.0
        ):  # what it prints first may be an answer to its own list, sent before
            while fetched != 4.0:
                since = client.types("param fetch MPC_XY_CRUISE")
                fetched = float((await client.says(r"MPC_XY_CRUISE = ([\d.]+)", since))[1])

        since = client.types("wp load mission.txt")
        await client.says("MISSION_ACK: TYPE_MISSION: ACCEPTED", since)
        since = client.types("wp list")
        await client.says("Saved 2 waypoints", since)
        kept = (await commands.run("mission_download")).value
        assert [item["command"] for item in kept] == [22, 16]

        since = client.types("arm throttle")
        await client.says("^ARMED", since)
        since = client.types(f"long DO_SET_MODE {MISSION}")
        await client.says("Mode MISSION", since)
        await served.until(lambda state: state.position_ned_m[0] > 15.0)
        since = client.types(f"long DO_SET_MODE {RTL}")
        await client.says("Mode RTL", since)
        await client.says("DISARMED", since)
    away_m = distances_m(
        [(lat / 1e7, lon / 1e7) for lat, lon in places_of_tlog(tmp_path / "mav.tlog")],
        home.lat_deg,
        home.lon_deg,
    )
    assert max(away_m) > 15.0
    assert away_m[-1] < 2.0
