"""What a ground station sets stays set over a reboot of real ArduCopter in a run."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from pymavlink import mavutil

pytestmark = pytest.mark.ardupilot

NAME = "RC7_OPTION"
SET_TO = 9.0
TIMEOUT_S = 60.0


def read_parameter(link: mavutil.mavfile) -> float:
    """Ask until the autopilot tells."""
    end_s = time.monotonic() + TIMEOUT_S
    while time.monotonic() < end_s:
        link.mav.param_request_read_send(1, 1, NAME.encode(), -1)
        message = link.recv_match(type="PARAM_VALUE", blocking=True, timeout=2)
        if message is not None and message.param_id == NAME:
            return float(message.param_value)
    raise AssertionError(f"{NAME} was not told within {TIMEOUT_S} s")


def reboot(link: mavutil.mavfile) -> None:
    """Ask for a reboot, and wait until the autopilot's clock has gone back."""
    end_s, latest_ms = time.monotonic() + TIMEOUT_S, 0
    while latest_ms < 5000:
        latest_ms = link.recv_match(type="ATTITUDE", blocking=True, timeout=TIMEOUT_S).time_boot_ms
    link.reboot_autopilot()
    while time.monotonic() < end_s:
        message = link.recv_match(type="ATTITUDE", blocking=True, timeout=TIMEOUT_S)
        if message.time_boot_ms < latest_ms:
            return
        latest_ms = message.time_boot_ms
    raise AssertionError("the autopilot did not reboot")


def test_set_then_reboot_keeps_the_parameter(
    arducopter: Path, tmp_path: Path, free_slot: Callable[[int], int]
) -> None:
    slot = free_slot(2)
    command = [sys.executable, "-m", "lostlink.cli.main", "run", "--speed", "1", "--out", str(tmp_path)]
    command += [
        "--autopilot",
        "ardupilot",
        "--first-slot",
        str(slot),
        "--zenoh-port",
        "0",
        "--duration",
        "300",
    ]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as run:
        try:
            assert run.stdout is not None
            while "sim time" not in (line := run.stdout.readline()):
                assert line, "the run ended before it flew"
            link = mavutil.mavlink_connection(f"tcp:127.0.0.1:{6760 + 10 * slot}", source_system=255)
            assert read_parameter(link) != SET_TO
            link.param_set_send(NAME, SET_TO)
            assert read_parameter(link) == SET_TO
            reboot(link)
            assert read_parameter(link) == SET_TO
            link.close()
        finally:
            run.terminate()
            run.stdout.read()
