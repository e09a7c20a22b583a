"""A whole run is closed: its passwords are kept, used and forgotten, and what strangers do changes nothing."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import stat
import subprocess
from pathlib import Path

import pytest
import zenoh
from click.testing import CliRunner, Result

from bridge.agents import connect_ua
from bridge.bus.identity.keyring import Credentials
from bridge.bus.keys import Keys
from bridge.bus.messages import AgentStatus, Header
from bridge.bus.session import SessionError, Stamp, open_client
from bridge.run.access import NoAccess, access_of
from lostlink.cli.main import lostlink
from tests.integration.bridge.clients.guarded import plain_config
from tests.integration.bridge.conftest import Run, StartRun


def token(run: Run, *options: str) -> Result:
    return CliRunner().invoke(lostlink, ["token", str(run.directory), *options])


def secrets_of(run: Run) -> dict[str, str]:
    lines = (run.directory / "secrets" / "passwords").read_text().splitlines()
    return dict(line.split(":", 1) for line in lines)


def assert_only_we_can_read(path: Path) -> None:
    for file in [path, *path.iterdir()]:
        status = file.stat()
        assert status.st_uid == os.getuid()
        assert stat.S_IMODE(status.st_mode) & 0o077 == 0


@pytest.mark.slow
async def test_passwords_are_kept_used_and_forgotten_and_strangers_change_nothing(
    start_run: StartRun,
) -> None:
    run = start_run("--set", "hosts=per-ua", speed="4", processes="many")
    await asyncio.to_thread(run.wait_for, "sim time")
    assert_only_we_can_read(run.directory / "secrets")
    secrets = secrets_of(run)
    secret = [password for user, password in secrets.items() if user != "observer"]
    check_tokens(run, secrets)
    for child in run.children():
        told = "\0".join([*child.cmdline(), *child.environ().values()])
        assert not [password for password in secret if password in told]
    do_what_strangers_do(run)
    async with connect_ua(run.directory, "1") as ua:
        state = await asyncio.wait_for(ua.wait_for(lambda state: state.mode != ""), 20.0)
        assert state.header.frame_id == "1"
        await ua.set_mode("GUIDED")
    run.stop(signal.SIGINT)
    assert run.summary["ending"] == "interrupted"
    assert run.summary["refused"] == {"without_stamp": 1}
    assert run.summary["counters"]["router"] == {
        "logins_refused_no_password": 1,
        "logins_refused_unknown_user": 1,
        "logins_refused_wrong_password": 1,
    }
    assert "refused a login (wrong_password)" in (run.directory / "logs" / "router.log").read_text()
    assert not (run.directory / "secrets").exists()
    left = b"".join(path.read_bytes() for path in run.directory.rglob("*") if path.is_file())
    assert not [password for password in secret if password.encode() in left]
    over = token(run, "--node", "1")
    assert (over.exit_code, over.stderr) == (1, f"lostlink: the run {run.directory} is over\n")
    with pytest.raises(NoAccess, match="is over"):
        access_of(run.directory, "node-1")


def check_tokens(run: Run, secrets: dict[str, str]) -> None:
    assert set(secrets) == {
        *("physics", "supervisor", "operator", "observer"),
        *(f"{kind}-{i}" for kind in ("host", "node") for i in (0, 1)),
    }
    assert len(set(secrets.values())) == len(secrets)
    assert min(len(password) for user, password in secrets.items() if user != "observer") >= 32
    assert json.loads(token(run, "--node", "1", "--json").stdout) == {
        "run": run.directory.name,
        "prefix": f"lostlink/{run.directory.name}",
        "endpoint": run.endpoint,
        "user": "node-1",
        "password": secrets["node-1"],
    }
    shell = f'{token(run, "--operator").stdout}\necho "$LOSTLINK_USER $LOSTLINK_PASSWORD $LOSTLINK_ENDPOINT"'
    said = subprocess.run(["sh", "-c", shell], capture_output=True, text=True, timeout=10).stdout.split()
    assert said == ["operator", secrets["operator"], run.endpoint]
    unknown = token(run, "--node", "7")
    assert unknown.exit_code == 1
    assert "nobody is called 'node-7' there; known: physics, host-0," in unknown.stderr


def do_what_strangers_do(run: Run) -> None:
    keys = Keys(run.directory.name)
    for credentials in (None, Credentials("node-0", "guess"), Credentials("root", "observer")):
        with pytest.raises(SessionError, match="does not let"):
            open_client(run.endpoint, credentials)
    with run.join("node-0") as node:
        for key in (keys.clock_end, keys.clock_release, keys.clock):
            node.put(key, Header.at(10**9, ""), must_arrive=True)
        node.put(keys.agent("1"), AgentStatus(Header.at(0, "1"), "I broke it", failed=True), must_arrive=True)
        node.put_bytes(keys.truth("1"), b"garbage", must_arrive=True)
        node.put_bytes(keys.answer("0"), b"garbage", must_arrive=True)
        node.put_bytes(keys.tx("1", "team"), b"x", attachment=Stamp(5, 0).to_bytes(), must_arrive=True)
        node.put_bytes(keys.rx("1", "0", "team"), b"never on the air", must_arrive=True)
        node.put_bytes(keys.tx("0", "team"), b"an agent of ours speaks for it", must_arrive=True)
    with run.join("host-0") as host:  # what it may write comes to the radio, which refuses and counts it
        host.put_bytes(keys.tx("0", "team"), b"without a stamp", must_arrive=True)


@pytest.mark.slow
def test_zenoh_can_be_asked_to_log_what_the_rules_refuse(
    start_run: StartRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RUST_LOG", "zenoh::net::routing::interceptor::access_control=trace")
    run = start_run(duration_s=10.0, speed="2", processes="many", anew=True)
    run.wait_for("sim time")
    keys = Keys(run.directory.name)
    with run.join("node-0") as node:
        node.put_bytes(keys.rx("1", "0", "team"), b"never on the air", must_arrive=True)
    assert run.finish() == 0, run.output.decode()
    log = (run.directory / "logs" / "router.log").read_text()
    assert f"is unauthorized to Put (ingress) on {keys.rx('1', '0', 'team')}" in log


@pytest.mark.slow
@pytest.mark.parametrize("processes", ["one", pytest.param("many", marks=pytest.mark.long)])
def test_observers_see_what_is_delivered_and_not_what_is_transmitted(
    start_run: StartRun, processes: str
) -> None:
    run = start_run(duration_s=15.0, speed="2", processes=processes)
    run.wait_for("sim time")
    settings = {"mode": "client", "connect__endpoints": [run.endpoint]}
    heard: set[str] = set()
    with zenoh.open(plain_config("observer", "observer", **settings)) as session:
        samples = session.declare_subscriber("lostlink/**")
        for sample in samples:
            heard.add(str(sample.key_expr).removeprefix(f"lostlink/{run.directory.name}/"))
            if {"node/1/rx/0/team", "node/0/rx/1/team", "truth/1", "clock/release"} <= heard:
                break
    assert not [key for key in heard if "/tx/" in key]
    assert run.finish() == 0, run.output.decode()
