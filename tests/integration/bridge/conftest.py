"""Real runs of `lostlink`, as a user starts them."""

from __future__ import annotations

import json
import os
import selectors
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import psutil
import pytest

from bridge.bus.session import Session
from bridge.run.access import access_of
from tests.warm import LOSTLINK, Command, is_as_ever

STILL = """\
schema: 1
name: still
description: Two UA on the ground, 410 m apart.
seed: 3
speed: {speed}
duration_s: {duration_s}
origin: {{lat_deg: 40.1331, lon_deg: -105.2404, alt_amsl_m: 1690.0}}
radio: moon2020
ports: {{zenoh: 0, first_slot: {slot}}}
nodes:
  - {{id: 0, agent: {{type: still}}}}
  - {{id: 1, home: {{north_m: 410}}, agent: {{type: still}}}}
"""


@dataclass
class Run:
    """A `lostlink run` in the background."""

    out: Path
    process: Command | subprocess.Popen[bytes]
    slot: int
    output: bytearray = field(default_factory=bytearray)

    @property
    def directory(self) -> Path:
        """The run's directory."""
        (found,) = self.out.iterdir()
        return found

    @property
    def summary(self) -> dict[str, Any]:
        """Its `summary.json`."""
        summary: dict[str, Any] = json.loads((self.directory / "summary.json").read_text())
        return summary

    def wait_for(self, text: str, timeout_s: float = 60.0) -> None:
        """Wait until the run has printed ``text``."""
        deadline = time.monotonic() + timeout_s
        assert self.process.stdout is not None
        with selectors.DefaultSelector() as selector:
            selector.register(self.process.stdout, selectors.EVENT_READ)
            while text.encode() not in self.output:
                assert selector.select(max(0.0, deadline - time.monotonic())), (
                    f"no {text!r} in {self.output.decode()}"
                )
                chunk = os.read(self.process.stdout.fileno(), 65536)
                assert chunk, f"ended before {text!r}: {self.output.decode()}"
                self.output += chunk

    def finish(self, timeout_s: float = 90.0) -> int:
        """Wait for its end; returns the exit status."""
        rest, _ = self.process.communicate(timeout=timeout_s)
        self.output += rest or b""
        return self.process.returncode

    def stop(self, number: signal.Signals) -> float:
        """Send a signal and wait for the end; returns how long that took, s."""
        start = time.monotonic()
        self.process.send_signal(number)
        self.finish(20.0)
        return time.monotonic() - start

    def child(self, name: str) -> psutil.Process:
        """The run's process of this name, which is forked from the command, or with ``name`` in its command line."""
        told = {}
        for child in self.children():
            with suppress(psutil.NoSuchProcess):  # one of its shorter errands
                told[child] = (child.name(), " ".join(child.cmdline()))
        found = [child for child, (its, words) in told.items() if its == name or name in words]
        assert found, f"no process with {name!r} among {list(told.values())}"
        return found[0]

    def children(self) -> list[psutil.Process]:
        """All processes below it."""
        return psutil.Process(self.process.pid).children(recursive=True)

    def join(self, identity: str) -> Session:
        """A client of its router, as one of its identities."""
        return access_of(self.directory, identity).open()

    @property
    def endpoint(self) -> str:
        """Where its Zenoh router listens."""
        return str(json.loads((self.directory / "run.json").read_text())["endpoint"])


StartRun = Callable[..., Run]


@pytest.fixture
def start_run(tmp_path: Path, free_slot: Callable[[int], int]) -> Iterator[StartRun]:
    """Start a run, ``anew`` or forked, with code that runs ``first`` there; whatever is left in the end is killed."""
    started: list[Run] = []

    def start(
        *arguments: str,
        scenario: str = STILL,
        speed: str = "max",
        duration_s: float = 600.0,
        only_stdout: bool = False,
        figure: bool = False,
        processes: str = "auto",
        anew: bool = False,
        first: str = "",
    ) -> Run:
        slot = free_slot(2)
        file = tmp_path / f"scenario-{len(started)}.yaml"
        file.write_text(scenario.format(speed=speed, duration_s=duration_s, slot=slot))
        out = tmp_path / f"out-{len(started)}"
        words = ["run", str(file), "--out", str(out), "--processes", processes, *arguments]
        words += [] if figure else ["--no-figure"]
        errors = subprocess.DEVNULL if only_stdout else subprocess.STDOUT
        pipes = {"stdout": subprocess.PIPE, "stderr": errors}
        process = (
            subprocess.Popen([*LOSTLINK, *words], **pipes, start_new_session=True)
            if anew or not (first or is_as_ever())
            else Command(*words, **pipes, start_new_session=True, first=first)
        )
        started.append(Run(out, process, slot))
        return started[-1]

    yield start
    for run in started:
        if run.process.poll() is None:
            with suppress(psutil.NoSuchProcess):  # killed by the test, its death is not yet told
                children = run.children()
                run.process.kill()
                for child in children:
                    with suppress(psutil.NoSuchProcess):  # it may die with the supervisor
                        child.kill()
        run.process.communicate()
