"""The commands of docs/how-to/modem.md, as they stand there, with ports that are free and for two seconds each."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
PAGE = ROOT / "docs" / "how-to" / "modem.md"
BLOCK = re.compile(r"^```(\w+) ?(\S*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
TEXT = PAGE.read_text(encoding="utf-8")
COMMANDS = [line for kind, _, text in BLOCK.findall(TEXT) if kind == "sh" for line in text.splitlines()]
LISTENS = re.compile(r"((?:tcpin|udpin):[\d.]*):\d+")


def write_files(folder: Path) -> None:
    for kind, name, text in BLOCK.findall(TEXT):
        if kind != "sh":
            (folder / name).write_text(text, encoding="utf-8")


def test_the_page_has_commands_of_all_kinds() -> None:
    assert len(COMMANDS) == 6
    for endpoint in ("tcp:", "tcpin:", "udp:", "udpin:", "pty"):
        assert any(endpoint in command for command in COMMANDS), endpoint


@pytest.mark.slow
@pytest.mark.timeout(300)
@pytest.mark.parametrize("command", COMMANDS)
def test_commands_of_the_page(command: str, tmp_path: Path) -> None:
    write_files(tmp_path)
    first, *words = shlex.split(LISTENS.sub(r"\1:0", command))
    options = ["-m", "lostlink", *words, "--duration", "2"] if first == "lostlink" else words
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, *options],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        timeout=250,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    if first == "lostlink":
        assert "ready: ground station at " in done.stderr
        assert re.search(r"^up: \d+ frames in", done.stdout, re.MULTILINE)
    else:
        assert "2 passed" in done.stdout
