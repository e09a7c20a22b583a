"""The process of a view beside a run: when it serves, and how its end is told."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from bridge.run.directory import RunDirectory
from lostlink.view import beside
from lostlink.view.beside import ViewProcess

SERVES = """
import socket, sys
with socket.create_server(("127.0.0.1", int(sys.argv[1]))) as server:
    sys.stdin.readline()
sys.exit({status})
"""


@pytest.fixture
def view(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> Iterator[ViewProcess]:
    """One whose process runs a script in place of the page."""

    def start(command: list[str], log: Any) -> subprocess.Popen[bytes]:
        port = command[command.index("--port") + 1]
        return subprocess.Popen(
            [sys.executable, "-c", request.param, port], stdin=subprocess.PIPE, stderr=log
        )

    monkeypatch.setattr(beside, "check_installed", lambda: None)
    monkeypatch.setattr(beside, "start_process", start)
    view = ViewProcess(0, control=False)
    yield view
    ends(view)


def ends(view: ViewProcess) -> None:
    """Let its process come to its end."""
    process = view._process
    assert process is not None
    assert process.stdin is not None
    process.stdin.close()


@pytest.mark.parametrize(
    ("view", "is_failure"),
    [(SERVES.format(status=3), True), (SERVES.format(status=0), False)],
    indirect=["view"],
    ids=["failed", "was asked to end"],
)
async def test_of_a_view_that_served_a_failure_is_told_once(
    view: ViewProcess, is_failure: bool, tmp_path: Path
) -> None:
    run = RunDirectory.create(tmp_path, "run")
    with view:
        view.start(run)
        failures = view.failures(run)
        assert await anext(failures) == ""
        ends(view)
        text = f"the view ended before the run; its log is {run.log_path('view')}"
        assert [failure async for failure in failures] == ([text] if is_failure else [])
        assert not view.failure(run)


@pytest.mark.parametrize("view", ["raise SystemExit(3)"], indirect=True)
async def test_a_view_that_never_served_is_told_once(view: ViewProcess, tmp_path: Path) -> None:
    run = RunDirectory.create(tmp_path, "run")
    with view:
        view.start(run)
        told = [failure async for failure in view.failures(run)]
        assert told == [f"the view has ended: the run begins without it; its log is {run.log_path('view')}"]
        assert not view.failure(run)
