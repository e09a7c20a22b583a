"""The commands of docs/how-to/on-the-air.md, as they stand there, with free ports and a station beside them."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from bridge.bus.session import free_port

ROOT = Path(__file__).parents[3]
PAGE = ROOT / "docs" / "how-to" / "on-the-air.md"
BLOCK = re.compile(r"^```(\w+) ?(\S*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
BLOCKS = BLOCK.findall(PAGE.read_text(encoding="utf-8"))
COMMANDS = [line for kind, _, text in BLOCKS if kind == "sh" for line in text.splitlines()]


def started(folder: Path, *words: str) -> subprocess.Popen[str]:
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.Popen(
        [sys.executable, *words],
        cwd=folder,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


@pytest.mark.long
@pytest.mark.timeout(300)
def test_commands_of_the_page(tmp_path: Path, free_slot: Callable[[int], int]) -> None:
    port, slot = str(free_port()), str(free_slot(2))
    for kind, name, text in BLOCKS:
        if kind != "sh":
            (tmp_path / name).write_text(text.replace("5790", port), encoding="utf-8")
    assert [shlex.split(command)[1] for command in COMMANDS] == ["check", "run", "check", "run", "refly"]
    for number, command in enumerate(COMMANDS):
        _, verb, *words = shlex.split(command)
        if verb != "check":
            words += ["--first-slot", slot, "--zenoh-port", "0"]
        words = [str(*tmp_path.glob(word)) if "*" in word else word for word in words]
        is_live = number == 1
        words += ["--duration", "40", "--speed", "4"] if is_live else []
        process = started(tmp_path, "-m", "lostlink", verb, *words)
        station = started(tmp_path, "station.py") if is_live else None
        told, _ = process.communicate(timeout=250)
        assert process.returncode == 0, told
        if "netid.yaml" in words:
            assert "NETID 25: gcs, 0, 1, 2" in told
        if station is not None:
            heard, _ = station.communicate(timeout=60)
            assert "ATTITUDE {" in heard, heard
            assert "RADIO_STATUS {" in heard
