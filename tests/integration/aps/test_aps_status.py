"""What running daemons tell, and how it is shown."""

import asyncio
import io
import json
import os
import socket

import pytest
from rich.console import Console

from aps.__main__ import main
from aps.daemon import Daemon, DaemonConfig
from aps.status import status_directory
from aps.status_view import ask, tables


@pytest.fixture(autouse=True)
def own_directory(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))


async def asked():
    return await asyncio.to_thread(lambda: list(ask(status_directory())))


def shown(answers):
    console = Console(width=200, record=True, file=io.StringIO())
    console.print(tables(answers))
    return console.export_text()


async def test_daemons_tell_state_and_counters_and_their_ends_leave_nothing(autopilot, connect, eventually):
    config = DaemonConfig(autopilot=f"tcp:127.0.0.1:{autopilot.port}", sysid=2)
    async with Daemon(config) as daemon, Daemon(DaemonConfig(autopilot="udp-in::0", sysid=9)) as idle:
        client = await connect(daemon.listen_port)
        client.writer.write(bytes(100))
        await eventually(lambda: daemon.statistics()["client_totals"]["skipped_bytes"] == 100)
        await eventually(lambda: daemon.state.mode == "STABILIZE")
        answers = {answer["sysid"]: answer for answer in await asked()}
        assert set(answers) == {2, 9}
        assert answers[2]["name"] == str(daemon.listen_port)
        assert answers[2]["state"]["mode"] == "STABILIZE"
        assert answers[9]["state"]["lat_deg"] is None
        text = shown(list(answers.values()))
        assert "STABILIZE" in text
        assert "skipped_bytes 100" in text
        assert f"tcp:127.0.0.1:{autopilot.port}" in text
        assert str(idle.listen_port) in text
    assert await asked() == []


def test_sockets_of_killed_daemons_are_removed():
    stale = status_directory() / "6760.sock"
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(stale))
    assert list(ask(status_directory())) == []
    assert not stale.exists()


def test_status_once(capsys):
    assert main(["status", "--once", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == []
    assert main(["status", "--once"]) == 0
    assert "no daemon of yours is running" in capsys.readouterr().out


def test_a_directory_of_others_is_refused(tmp_path, capsys):
    path = tmp_path / f"lostlink-aps-{os.getuid()}"
    path.mkdir(mode=0o777)
    path.chmod(0o777)
    assert main(["status", "--once"]) == 2
    assert "is not a directory of yours alone" in capsys.readouterr().err
