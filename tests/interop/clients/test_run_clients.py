"""Programs of others on a run that goes on: MAVSDK."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]


@pytest.mark.parametrize("way", ["tcp", pytest.param("udp", marks=pytest.mark.slow)])
def test_mavsdk_finds_ua_0_and_its_position(
    tmp_path: Path, free_slot: Callable[[int], int], way: str
) -> None:
    slot = free_slot(2)
    assert slot >= 10, "else the UDP port is another one"
    command = [sys.executable, "-m", "lostlink.cli.main", "run", "--speed", "1", "--out", str(tmp_path)]
    command += ["--first-slot", str(slot), "--zenoh-port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as run:
        assert run.stdout is not None
        while "sim time" not in (line := run.stdout.readline()):
            assert line, "the run ended before it flew"
        watch = [
            sys.executable,
            str(ROOT / "examples" / "clients" / "mavsdk_watch.py"),
            f"tcpout://127.0.0.1:{6760 + 10 * slot}" if way == "tcp" else f"udpin://127.0.0.1:{14600 + slot}",
        ]
        with subprocess.Popen(watch, stdout=subprocess.PIPE, text=True) as client:
            assert client.stdout is not None
            lines = []
            while len(lines) < 2 and (line := client.stdout.readline()):
                lines += [line] if re.search(r"system \d+ is there|Position\(", line) else []
            client.kill()
        run.terminate()
        run.stdout.read()
    assert "system 1 is there" in lines[0]
    assert "latitude_deg=40.133" in lines[1]
