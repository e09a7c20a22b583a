"""MAVProxy on one vehicle, as a child that takes its commands line by line."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.interop.served import PARAMETERS_AT_LEAST, Served, mavproxy, places_of_tlog, waypoint_file

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]


@pytest.fixture
def sim_speed() -> float:
    """An autopilot gives an upload up after 8 s of its own time, and MAVProxy may be late when the machine is busy."""
    return 2.0


async def test_mavproxy(served: Served, tmp_path: Path) -> None:
    waypoint_file(served, tmp_path)
    async with mavproxy(served, tmp_path) as client:
        await client.says("online system 4")
        assert int((await client.says(r"Received (\d+) parameters"))[1]) >= PARAMETERS_AT_LEAST[served.kind]
        connected = list(client.lines)
        for wrong in ("warn", "breach", "fail", "error", "timed? ?out", "no link", "down", "unknown"):
            assert not [line for line in connected if re.search(wrong, line, re.IGNORECASE)], wrong

        since = client.types("param fetch")
        again = await client.says(r"Received (\d+) parameters", since)
        assert int(again[1]) == len((await served.daemon.commands.run("parameters")).value)
        since = client.types("wp load mission.txt")
        await client.says("Sent all 4 waypoints", since)
        await client.says("MISSION_ACK: TYPE_MISSION: ACCEPTED", since)
        since = client.types("wp list")
        await client.says(r"^22 3 \S+ \S+ (20|60)\.0", since)
        await client.says("Saved 4 waypoints", since)
        since = client.types("wp set 2")
        await client.says("waypoint 2", since)
        await client.says("DO_SET_MISSION_CURRENT: ACCEPTED", since)
        since = client.types("mode LOITER")
        await client.says("Mode LOITER", since)
        await served.until(lambda state: state.mode == "LOITER")
        since = client.types("mode GUIDED")
        await client.says("Mode GUIDED", since)
        await served.until(lambda state: state.mode == "GUIDED")

        fence = tmp_path / "fence.txt"
        state = served.daemon.state
        corners = [(-1, -1), (-1, 1), (1, 1), (1, -1)]
        rows = [
            f"{seq}\t0\t0\t5001\t4\t0\t0\t0\t{state.lat_deg + n * 0.01:.7f}\t{state.lon_deg + e * 0.01:.7f}\t0\t1"
            for seq, (n, e) in enumerate(corners)
        ]
        fence.write_text("QGC WPL 110\n" + "\n".join(rows) + "\n")
        since = client.types(f"fence load {fence.name}")
        await client.says("MISSION_ACK: TYPE_FENCE: ACCEPTED", since)
        since = client.types("fence list")
        await client.says("Saved 4 fence items", since)
        kept = (await served.daemon.commands.run("mission_download", kind="fence")).value
        assert [item["command"] for item in kept] == [5001] * 4
    places = places_of_tlog(tmp_path / "mav.tlog")
    assert len(places) > 50
    assert set(places) <= served.places_e7
