"""The commands of docs/how-to/attach.md, as they stand there, on the page's own scenario and programs."""

from __future__ import annotations

import os
import re
import selectors
import shlex
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.integration.lostlink.namespaces import LOSTLINK, WHY_NO_NAMESPACE

ROOT = Path(__file__).parents[3]
PAGE = ROOT / "docs" / "how-to" / "attach.md"
BLOCK = re.compile(r"^```(\w+) ?(\S*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
BLOCKS = BLOCK.findall(PAGE.read_text(encoding="utf-8"))
COMMANDS = [line for kind, _, text in BLOCKS if kind == "sh" for line in text.splitlines()]
[READS] = [text for kind, name, text in BLOCKS if kind == "python" and not name]
MISSING = [program for program in ("ping", "iperf3") if shutil.which(program) is None]
WAIT_S = 60.0
pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(300),
    pytest.mark.skipif(bool(WHY_NO_NAMESPACE), reason=WHY_NO_NAMESPACE),
    pytest.mark.skipif(bool(MISSING), reason=f"not here: {', '.join(MISSING)}"),
]


def serves(command: str) -> bool:
    """Whether it waits for another one."""
    return "--server" in command or command.endswith("echo.py")


def words_of(command: str, run: str) -> list[str]:
    first, *words = shlex.split(command.replace("runs/A", run))
    assert first == "lostlink"
    return [*LOSTLINK, *(sys.executable if word == "python" else word for word in words)]


def wait_for(process: subprocess.Popen[bytes], text: bytes) -> None:
    """Wait until it has said something."""
    assert process.stdout is not None
    said = b""
    with selectors.DefaultSelector() as selector:
        selector.register(process.stdout, selectors.EVENT_READ)
        while text not in said:
            assert selector.select(WAIT_S), said
            chunk = os.read(process.stdout.fileno(), 65536)
            assert chunk, said
            said += chunk


@pytest.mark.slow
@pytest.mark.long
def test_the_commands_of_the_page(tmp_path: Path, free_slot: Callable[[int], int]) -> None:
    for _, name, text in BLOCKS:
        if name:
            (tmp_path / name).write_text(text, encoding="utf-8")
    flies, *attached, again = COMMANDS
    assert len(attached) == 5
    ports = ["--first-slot", str(free_slot(2)), "--zenoh-port", "0"]
    with ExitStack() as stack:

        def start(words: list[str]) -> subprocess.Popen[bytes]:
            process = subprocess.Popen(words, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
            stack.enter_context(process)
            stack.callback(process.kill)
            return process

        run = start([*words_of(flies, ""), *ports, "--no-figure"])
        wait_for(run, b"sim time")
        [directory] = (tmp_path / "runs").iterdir()
        for command in attached:
            process = start(words_of(command, str(directory)))
            if serves(command):
                wait_for(process, b"others: ")
                continue
            said, _ = process.communicate(timeout=WAIT_S)
            assert process.returncode == 0, (command, said)
            assert re.search(rb"\d+ packets sent \(\d+ bytes\), \d+ received", said)
        run.send_signal(signal.SIGINT)
        run.communicate(timeout=WAIT_S)
        told, _ = start([*words_of(again, str(directory)), *ports, "--quiet"]).communicate(timeout=WAIT_S)
        assert b"identical" in told
        reads = READS.replace("runs/A", str(directory))
        counts, _ = start([sys.executable, "-c", reads]).communicate(timeout=WAIT_S)
        assert re.search(rb"^0 +1 +delivered +\d+$", counts, re.MULTILINE), counts
