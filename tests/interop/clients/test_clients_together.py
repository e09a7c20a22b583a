"""Many programs on one UA at once: each sees the same vehicle, and none is in another's way."""

from __future__ import annotations

import contextlib
import re
import socket
from pathlib import Path

import pytest

from tests.interop.served import CLIENTS, Program, Served, mavproxy, places_of_tlog, program

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]

E7 = re.compile(r"\blat : (-?\d+), lon : (-?\d+)")
DEGREES = re.compile(r"(?:latitude_deg=|^at )(-?\d+\.\d+)(?:, longitude_deg=| )(-?\d+\.\d+)")


def free_udp_port() -> int:
    with socket.socket(type=socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def places_e7(lines: list[str]) -> list[tuple[int, int]]:
    """The places that a program has printed, 1e-7 degrees."""
    found = [(int(m[1]), int(m[2])) for line in lines if (m := E7.search(line))]
    degrees = [(float(m[1]), float(m[2])) for line in lines if (m := DEGREES.search(line))]
    return found + [(round(lat * 1e7), round(lon * 1e7)) for lat, lon in degrees]


async def test_all_at_once_on_one_ua(served: Served, tmp_path: Path) -> None:
    udp_port = free_udp_port()
    await served.daemon.open(f"udp-out:127.0.0.1:{udp_port}")
    everything = (await served.daemon.commands.run("parameters")).value
    watchers: list[Program] = []
    async with contextlib.AsyncExitStack() as running:
        # First: values that another one has asked for, it takes for its own, and then says nothing of a fetch.
        console = await running.enter_async_context(mavproxy(served, tmp_path))
        await console.says(rf"Received {len(everything)} parameters")
        for words in (
            (CLIENTS / "mavsdk_watch.py", served.mavsdk, "246"),
            (CLIENTS / "mavsdk_watch.py", served.mavsdk, "247"),
            (CLIENTS / "mavsdk_watch.py", f"udpin://127.0.0.1:{udp_port}", "248"),
            (CLIENTS / "mavlink_client.py", served.tcp),
            (CLIENTS / "dronekit_flight.py", served.tcp, "--watch"),
        ):
            watchers.append(await running.enter_async_context(program(*words)))
        for watcher in watchers:
            await watcher.says(f"{E7.pattern}|{DEGREES.pattern}")
        before = [len(watcher.lines) for watcher in watchers]

        flags = ["--fixed-wing"] if served.is_plane else []
        pilot = await running.enter_async_context(
            program(CLIENTS / "mavsdk_flight.py", served.mavsdk, *flags)
        )
        await pilot.says("armed: True")
        await console.says("ARMED")
        since = console.types("param fetch")
        await console.says(rf"Received {len(everything)} parameters", since)
        since = console.types("wp list")
        await console.says("Saved|Requesting 0", since)
        flown = await pilot.ends_well()
        for watcher, lines in zip(watchers, before, strict=True):
            await watcher.says(f"{E7.pattern}|{DEGREES.pattern}", max(lines, len(watcher.lines)))
        served_places = frozenset(served.places_e7)
        told = [places_e7(watcher.lines[:-1]) for watcher in watchers]

    assert f"parameters: {len(everything)}" in "\n".join(flown)
    for watcher, places in zip(watchers, told, strict=True):
        assert len(set(places)) > 10, watcher
        assert set(places) <= served_places, watcher
    assert set(places_of_tlog(tmp_path / "mav.tlog")) <= frozenset(served.places_e7)
    others = re.compile(
        "COMMAND_ACK: (COMPONENT_ARM_DISARM|NAV_TAKEOFF|DO_REPOSITION|DO_SET_MODE|MISSION_START)"
    )
    assert not [line for line in console.lines if others.search(line)], "answers to others are not for it"
    assert not [line for line in console.lines if re.search(r"link \d+ down", line)]
