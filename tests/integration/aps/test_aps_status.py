"""What running daemons tell, and how it is shown."""

import asyncio
import io
import json
import os
import socket
import threading

import pytest
from rich.console import Console

from aps import status
from aps.__main__ import main
from aps.api.backend import DaemonBackend
from aps.api.guard import ApiConfig
from aps.api.server import ApiServer
from aps.daemon import Daemon, DaemonConfig
from aps.status import status_directory
from aps.status_view import ask, ask_over_http, tables


@pytest.fixture(autouse=True)
def own_directory(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))


TOKEN = "0123456789abcdef-token"


async def test_daemons_are_shown_by_their_apis(autopilot, eventually, capsys, monkeypatch):
    config = DaemonConfig(autopilot=f"tcp:127.0.0.1:{autopilot.port}", sysid=2)
    async with (
        Daemon(config) as daemon,
        ApiServer(DaemonBackend(daemon), ApiConfig()) as open_to_all,
        ApiServer(DaemonBackend(daemon), ApiConfig(token=TOKEN)) as guarded,
    ):
        await eventually(lambda: daemon.state.mode == "STABILIZE")
        urls = [f"http://127.0.0.1:{open_to_all.port}/", f"127.0.0.1:{guarded.port}", "http://127.0.0.1:1"]
        first, second, third = await asyncio.to_thread(lambda: list(ask_over_http(urls, "")))
        assert (first["name"], first["sysid"]) == (f"127.0.0.1:{open_to_all.port}", 2)
        assert second["error"] == "it wants its token"
        assert "refused" in third["error"]
        assert "STABILIZE" in shown([first, second, third])
        assert await asyncio.to_thread(main, ["status", "--once", "--url", urls[1]]) == 1
        assert "it wants its token" in capsys.readouterr().out
        assert await asyncio.to_thread(main, ["status", "--once", "--url", urls[0]]) == 0
        assert "heartbeat" in capsys.readouterr().out  # in one piece, though this is no terminal
        monkeypatch.setenv("LOSTLINK_API_TOKEN", TOKEN)
        arguments = ["status", "--once", "--json", "--url", urls[1]]
        assert await asyncio.to_thread(main, arguments) == 0
        [told] = json.loads(capsys.readouterr().out)
        assert told["state"]["mode"] == "STABILIZE"


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


async def test_a_wrong_system_id_is_shown_with_the_one_that_is_there(autopilot, eventually, caplog):
    config = DaemonConfig(autopilot=f"tcp:127.0.0.1:{autopilot.port}", sysid=7)
    async with Daemon(config) as daemon:
        await eventually(lambda: daemon.statistics()["other_systems"] == [2])
        [told] = await asked()
    assert "7 (there is 2)" in shown([told])
    assert "calls itself system 2, expected 7 (--sysid)" in caplog.text


def test_sockets_of_killed_daemons_are_removed():
    stale = status_directory() / "6760.sock"
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(stale))
    assert list(ask(status_directory())) == []
    assert not stale.exists()


async def test_the_next_daemon_removes_them_and_leaves_those_of_others(autopilot):
    stale, begins = status_directory() / "6760.sock", status_directory() / "6770.sock"
    config = DaemonConfig(autopilot=f"tcp:127.0.0.1:{autopilot.port}", sysid=2)
    somebodys = status_directory() / "my.sock"
    somebodys.mkdir()
    with socket.socket(socket.AF_UNIX) as killed, socket.socket(socket.AF_UNIX) as starting:
        killed.bind(str(stale))
        starting.bind(str(begins))  # and does not listen yet
        killed.close()
        async with Daemon(config) as daemon:
            assert not stale.exists()
            assert begins.exists()
            assert somebodys.is_dir()
            assert [answer["name"] for answer in await asked()] == [str(daemon.listen_port)]
            assert begins.exists()


def test_none_is_removed_while_another_binds(monkeypatch):
    """Who has found one stale would remove that of a daemon which has bound its name since."""
    path = status_directory() / "6760.sock"
    with socket.socket(socket.AF_UNIX) as killed:
        killed.bind(str(path))
    found, servers = threading.Event(), []
    is_stale = status._is_stale

    def looks(path):
        was_stale = is_stale(path)
        found.set()
        binding.join(0.2)
        return was_stale

    def bind():
        found.wait(10.0)
        servers.append(status.StatusServer("6760", dict)._bound())

    monkeypatch.setattr(status, "_is_stale", looks)
    monkeypatch.setattr(status, "_removed_stale", lambda _: None)
    binding = threading.Thread(target=bind)
    binding.start()
    status.remove_stale(status_directory())
    binding.join(10.0)
    assert path.exists()
    servers[0].close()


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
