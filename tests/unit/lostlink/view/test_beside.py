"""The process of a view beside a run: when it serves, and how its end is told."""

from __future__ import annotations

import asyncio
import errno
import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from bridge.run.directory import RunDirectory
from lostlink.view import beside
from lostlink.view.beside import NoView, ViewProcess, check_installed

SERVES = """
import socket, sys
with socket.create_server(("127.0.0.1", int(sys.argv[1]))) as server:
    print(f"view: http://127.0.0.1:{{sys.argv[1]}}/", flush=True)
    sys.stdin.readline()
sys.exit({status})
"""
FINDS_ITS_PORT_TAKEN = "import sys; sys.stdin.readline(); sys.exit(1)"


@pytest.fixture
def view(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> Iterator[ViewProcess]:
    """One whose process runs a script in place of the page."""

    def start(command: list[str], log: Any) -> subprocess.Popen[bytes]:
        port = command[command.index("--port") + 1]
        return subprocess.Popen(
            [sys.executable, "-c", request.param, port], stdin=subprocess.PIPE, stdout=log, stderr=log
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
    ("view", "is_flying", "told"),
    [
        (SERVES.format(status=3), True, ["the view ended before the run; its log is {log}"]),
        (SERVES.format(status=0), True, ["the view was asked to end: the run goes on without it"]),
        (SERVES.format(status=0), False, []),
    ],
    indirect=["view"],
    ids=["failed", "was asked to end", "ended with the run"],
)
async def test_of_a_view_that_served_its_end_is_told_once(
    view: ViewProcess, is_flying: bool, told: list[str], tmp_path: Path
) -> None:
    run = RunDirectory.create(tmp_path, "run")
    with view:
        view.start(run)
        failures = view.failures(run, lambda: is_flying)
        assert await anext(failures) == ""
        ends(view)
        log = run.log_path("view")
        assert [failure async for failure in failures] == [text.format(log=log) for text in told]
        assert not view.failure(run)


@pytest.mark.parametrize("view", ["raise SystemExit(3)"], indirect=True)
async def test_a_view_that_never_served_is_told_once(view: ViewProcess, tmp_path: Path) -> None:
    run = RunDirectory.create(tmp_path, "run")
    with view:
        view.start(run)
        told = [failure async for failure in view.failures(run, lambda: True)]
        assert told == [f"the view has ended: the run begins without it; its log is {run.log_path('view')}"]
        assert not view.failure(run)


@pytest.mark.parametrize("view", [FINDS_ITS_PORT_TAKEN], indirect=True)
async def test_another_listener_at_its_port_is_not_taken_for_the_view(
    view: ViewProcess, tmp_path: Path
) -> None:
    run = RunDirectory.create(tmp_path, "run")
    with view, socket.create_server(("127.0.0.1", view.port)):
        view.start(run)
        first = asyncio.ensure_future(anext(view.failures(run, lambda: True)))
        assert not (await asyncio.wait({first}, timeout=3 * beside.LOOK_AGAIN_S))[0]
        ends(view)
        told = await first
        assert told.startswith(f"the view has ended, as TCP port {view.port} (live view) is in use")
        assert "choose another with --view-port" in told
        assert "the run begins without it" in told


def test_a_machine_without_shared_memory_is_told_before_the_page_is_promised(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refused() -> None:
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))

    monkeypatch.setattr("multiprocessing.Lock", refused)
    with pytest.raises(
        NoView, match=r"^the live view needs shared memory, which /dev/shm has not: Permission denied$"
    ):
        check_installed()
