"""The commands of docs/how-to/clients.md, as they stand there, on a run of the scenario that the page starts."""

from __future__ import annotations

import contextlib
import re
import shlex
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from pymavlink import mavutil

from tests.interop.clients.test_clients_together import free_udp_port
from tests.interop.served import Program, program

pytestmark = [pytest.mark.slow, pytest.mark.timeout(400)]

GUIDED = 4
ROOT = Path(__file__).parents[3]
TYPED = {
    "wp load": "Sent all 4",
    "wp list": "Saved 4",
    "mode": "Mode LOITER",
    "fence": "0 fence",
    "param": "RTL_ALT",
}
"""What MAVProxy says to a command of the page."""
PAGE = (ROOT / "docs" / "how-to" / "clients.md").read_text()
COMMANDS = re.findall(r"^    ((?:python|mavproxy\.py) .*)$", PAGE, re.MULTILINE)
LAST_LINE = {
    "mavsdk_watch.py": "Position",
    "mavsdk_flight.py": "landed and disarmed",
    "mavsdk_mission.py": "mode: RETURN_TO_LAUNCH",
    "pymavlink_mission.py": "mode: RTL",
    "dronekit_flight.py": "landed and disarmed",
    "mavproxy.py": r"Received \d+ parameters",
}


@contextlib.contextmanager
def running(slot: int, udp_port: int, directory: Path) -> Iterator[None]:
    (scenario,) = re.findall(r"^    lostlink run (\S+)$", PAGE, re.MULTILINE)
    command = [sys.executable, "-m", "lostlink.cli.main", "run", str(ROOT / scenario), "--speed", "3"]
    command += ["--first-slot", str(slot), "--zenoh-port", "0", "--out", str(directory)]
    command += ["--udp-out", f"127.0.0.1:{udp_port}"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as run:
        assert run.stdout is not None
        while "sim time" not in (line := run.stdout.readline()):
            assert line, "the run ended before it flew"
        try:
            yield
        finally:
            run.terminate()
            run.communicate()


def choose_guided(address: str) -> None:
    """Wait until it has landed; then choose GUIDED, as a copter cannot be armed in RTL."""
    link = mavutil.mavlink_connection(address, source_system=250)

    def heartbeat() -> Any:
        for _ in range(200):
            message = link.recv_match(type="HEARTBEAT", blocking=True, timeout=10)
            if message is not None and message.autopilot == mavutil.mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA:
                return message
        raise AssertionError("the vehicle has fallen silent")

    while heartbeat().base_mode & mavutil.mavlink.MAV_MODE_FLAG_SAFETY_ARMED:
        pass
    while heartbeat().custom_mode != GUIDED:
        link.mav.set_mode_send(1, mavutil.mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, GUIDED)
    link.close()


async def type_what_the_page_says(client: Program) -> None:
    for start, answer in TYPED.items():
        (line,) = re.findall(rf"`({start}[^`]*)`", PAGE[: PAGE.index("What it prints")])
        since = client.types(line.replace("param set", "param show").replace(" 2000", ""))
        await client.says(answer, since)


def test_the_page_has_a_command_of_each_kind() -> None:
    assert {name for name in LAST_LINE if any(name in command for command in COMMANDS)} == set(LAST_LINE)


@pytest.mark.long
async def test_commands_of_the_page(tmp_path: Path, free_slot: Callable[[int], int]) -> None:
    slot, udp_port = free_slot(1), free_udp_port()
    port = 6760 + 10 * slot
    with running(slot, udp_port, tmp_path / "runs"):
        for command in COMMANDS:
            here = command.replace(":6760", f":{port}").replace(":14540", f":{udp_port}")
            (said,) = {line for name, line in LAST_LINE.items() if name in command}
            choose_guided(f"tcp:127.0.0.1:{port}")
            first, *words = shlex.split(here)
            if first == "mavproxy.py":
                words = [
                    "-u",
                    str(Path(sys.executable).with_name(first)),
                    *words,
                    "--state-basedir",
                    str(tmp_path),
                ]
            async with program(*words, cwd=ROOT) as client:
                await client.says(said)
                if first == "mavproxy.py":
                    await type_what_the_page_says(client)
