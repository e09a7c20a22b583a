"""What the commands say of the view before anything is started."""

from __future__ import annotations

import asyncio
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from bridge.run.directory import RunDirectory
from lostlink.cli.main import lostlink
from lostlink.view import beside as viewing
from tests.unit.lostlink.replay.flown import flown, scenario_of


@pytest.mark.parametrize(("command", "status"), [(["run", "--view"], 2), (["view", "anything"], 1)])
def test_without_the_package_it_is_told_what_to_install(
    command: list[str], status: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(viewing, "find_spec", lambda _: None)
    result = CliRunner().invoke(lostlink, command)
    assert result.exit_code == status
    assert result.stderr == "lostlink: the live view needs NiceGUI: pip install 'lostlink[view]'\n"


def test_control_needs_a_view() -> None:
    result = CliRunner().invoke(lostlink, ["run", "--control"])
    assert result.exit_code == 2
    assert "needs --view" in result.stderr


def test_the_token_comes_from_the_environment_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LOSTLINK_API_TOKEN", "short")
    result = CliRunner().invoke(lostlink, ["view", "anything"])
    assert result.exit_code == 2
    assert "the token must have at least 16 characters" in result.stderr


def test_a_port_that_is_taken_is_told_with_the_option_that_helps(tmp_path: Path) -> None:
    pytest.importorskip("nicegui")
    record = flown(tmp_path / "run", scenario_of("moon2020", ["0", "1"]), 3)
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = str(server.getsockname()[1])
        command = [sys.executable, "-m", "lostlink", "view", str(record), "--port", port]
        ended = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert ended.returncode == 1
    assert ended.stderr.startswith(f"lostlink: TCP port {port} (live view) is in use by ")
    assert ended.stderr.endswith(": free it, or choose another with --port N (0: any)\n")


async def test_a_run_that_was_killed_before_it_is_looked_at_is_not_waited_for(tmp_path: Path) -> None:
    pytest.importorskip("nicegui")
    from lostlink.view.process import wait_for_start

    run = RunDirectory(tmp_path)
    (tmp_path / "live.lock").touch()
    async with asyncio.timeout(10.0):
        assert not await wait_for_start(run, asyncio.Event(), has_begun=True)
