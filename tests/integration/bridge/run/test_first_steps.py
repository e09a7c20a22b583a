"""The page that a newcomer follows, followed: files written as it shows them, commands run in its order."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[4]
PAGE = ROOT / "docs" / "tutorial" / "first-steps.md"
BLOCK = re.compile(r"^```(\w+) ?(\S*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
SHOWN = {
    "lostlink run --duration 20 --seed 7 --out runs": "pass",
    "python look.py": "delivered",
    "lostlink run together.yaml --out own": "expectations hold|pass",
    "lostlink study study.yaml": "metrics.parquet",
}
"""What some commands have to say."""


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.timeout(1500)
def test_every_command_of_the_page_works(tmp_path: Path, free_slot: Callable[[int], int]) -> None:
    tools = tmp_path / "bin"
    tools.mkdir()
    elsewhere = f'[ "$1" = run ] && set -- "$@" --first-slot {free_slot(2)} --zenoh-port 0'
    for name, module, ports in (("python", "", ""), ("lostlink", "-m lostlink", elsewhere)):
        (tools / name).write_text(f'#!/bin/sh\n{ports}\nexec "{sys.executable}" {module} "$@"\n')
        (tools / name).chmod(0o755)
    work = tmp_path / "work"
    work.mkdir()
    environment = {**os.environ, "PATH": f"{tools}{os.pathsep}{os.environ['PATH']}"}
    commands = 0
    for kind, name, text in BLOCK.findall(PAGE.read_text(encoding="utf-8")):
        if kind != "sh":
            assert name, f"a block of {kind} has no file name"
            (work / name).write_text(text, encoding="utf-8")
            continue
        for command in text.splitlines():
            commands += 1
            done = subprocess.run(
                command,
                shell=True,
                cwd=work,
                env=environment,
                capture_output=True,
                text=True,
                timeout=400,
                check=False,
            )
            assert done.returncode == 0, f"{command}\n{done.stdout[-2000:]}\n{done.stderr[-2000:]}"
            if command in SHOWN:
                assert re.search(SHOWN[command], done.stdout), done.stdout
    assert commands == 9
    assert (work / "report.html").stat().st_size > 10_000
    assert (work / "studies" / "together" / "delivery.png").exists()
    assert len(list((work / "studies" / "together" / "runs").iterdir())) == 4
