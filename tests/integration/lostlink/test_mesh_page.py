"""The commands of docs/how-to/mesh.md, as they stand there, in their order: a flight, its report, its picture."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml

from bridge.scenario.resolve.radio import radio_of
from lostlink.reading.run import load_run

ROOT = Path(__file__).parents[3]
TEXT = (ROOT / "docs" / "how-to" / "mesh.md").read_text(encoding="utf-8")
BLOCK = re.compile(r"^```(\w+) ?(\S*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
COMMANDS = [line for kind, _, text in BLOCK.findall(TEXT) if kind == "sh" for line in text.splitlines()]


def test_the_page_says_of_the_radio_what_the_example_has() -> None:
    first = next(text for kind, _, text in BLOCK.findall(TEXT) if kind == "yaml")
    example = yaml.safe_load((ROOT / "examples" / "ground_nodes" / "beyond_range.yaml").read_text())
    assert yaml.safe_load(first)["radio"] == example["radio"]


@pytest.mark.slow
@pytest.mark.timeout(400)
@pytest.mark.long
def test_commands_of_the_page(tmp_path: Path, free_slot: Callable[[int], int]) -> None:
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    for kind, name, text in BLOCK.findall(TEXT):
        if kind == "python":
            (tmp_path / name).write_text(text, encoding="utf-8")
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "MPLBACKEND": "Agg"}
    told = {}
    for command in COMMANDS:
        line = command.replace("lostlink run", f"lostlink run --first-slot {free_slot(4)} --zenoh-port 0")
        line = re.sub(r"^lostlink", f"{sys.executable} -m lostlink", line)
        line = re.sub(r"^python", sys.executable, line)
        done = subprocess.run(
            ["bash", "-c", line],
            cwd=tmp_path,
            env=environment,
            capture_output=True,
            text=True,
            timeout=300,
            check=False,
        )
        assert done.returncode == 0, line + done.stdout + done.stderr
        told[command] = done.stdout
    [path] = (tmp_path / "runs").iterdir()
    run = load_run(path)
    assert radio_of(run.scenario).config.routing.model == "mesh"
    hops = run.routes.query("tx == '0' and rx == 'gcs'").groupby("arrived_ns").hop.max()
    assert {1, 2, 3} <= set(hops)
    assert (path / "report.html").exists()
    assert (tmp_path / "ways.png").stat().st_size > 10_000
    assert re.search(r"^0 > 2 > 1\s+\d+$", told[COMMANDS[2]], re.MULTILINE)
