"""``python -m aps`` as users run it."""

import asyncio
import json
import signal
import sys
import time

import pytest


async def start(*arguments):
    return await asyncio.create_subprocess_exec(
        sys.executable,
        "-m",
        "aps",
        *arguments,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
    )


async def line(process):
    return (await asyncio.wait_for(process.stdout.readline(), 20)).decode()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
async def test_ready_line_and_clean_exit(autopilot, connect, number):
    process = await start(
        "--autopilot", f"tcp:127.0.0.1:{autopilot.port}", "--sysid", "2", "--listen", "127.0.0.1:0"
    )
    ready = await line(process)
    assert ready.startswith("READY aps sysid=2 listen=127.0.0.1:")
    port = int(ready.split("listen=127.0.0.1:")[1].split()[0])
    client = await connect(port)
    await client.next("HEARTBEAT", lambda message: message.get_srcComponent() == 1)
    begin = time.monotonic()
    process.send_signal(number)
    _, stderr = await asyncio.wait_for(process.communicate(), 5)
    assert time.monotonic() - begin < 1.0
    assert process.returncode == 0
    assert b"Traceback" not in stderr


async def test_state_as_json_lines(autopilot):
    process = await start(
        "--json",
        "--rate-hz=5",
        "--quiet",
        "--autopilot",
        f"tcp:127.0.0.1:{autopilot.port}",
        "--sysid=2",
        "--listen=127.0.0.1:0",
    )
    try:
        ready = json.loads(await line(process))
        assert (ready["event"], ready["sysid"]) == ("ready", 2)
        states = [json.loads(await line(process)) for _ in range(30)]
        assert {state["event"] for state in states} == {"state"}
        assert states[-1]["lat_deg"] == pytest.approx(47.0)
        assert states[-1]["wind_ned_mps"] == [None, None, None]
    finally:
        process.terminate()
        _, stderr = await process.communicate()
    assert stderr == b""


async def test_port_in_use_is_one_line_that_names_port_and_option(autopilot):
    process = await start("--listen", f"127.0.0.1:{autopilot.port}", "--quiet")
    stdout, stderr = await asyncio.wait_for(process.communicate(), 20)
    assert process.returncode == 2
    assert stdout == b""
    (message,) = stderr.decode().splitlines()
    assert f"port {autopilot.port} is in use" in message
    assert "--listen" in message


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--sysid", "0"], "--sysid must be in 1..255, not 0"),
        (["--index", "-1"], "--index must be in 0..254, not -1"),
        (["--listen", "6760"], "'6760' is not HOST:PORT"),
        (["--autopilot", "udp:127.0.0.1:1"], "'udp:127.0.0.1:1' is not tcp:HOST:PORT"),
        (["--rate-hz", "0"], "--rate-hz must be positive, not 0.0"),
        (["--listen", "203.0.113.1:6760"], "cannot listen on 203.0.113.1:6760"),
    ],
)
async def test_wrong_arguments_are_one_line(arguments, message):
    process = await start(*arguments)
    _, stderr = await asyncio.wait_for(process.communicate(), 20)
    assert process.returncode == 2
    (told,) = stderr.decode().splitlines()
    assert message in told


async def test_help_has_examples():
    process = await start("--help")
    stdout, _ = await asyncio.wait_for(process.communicate(), 20)
    assert process.returncode == 0
    assert b"python -m aps --autopilot tcp:127.0.0.1:5760 --sysid 1 --listen 127.0.0.1:6760" in stdout


async def test_a_daemon_that_fails_of_itself_ends_the_program():
    process = await start("--autopilot", f"tcp:{'a' * 70}.example:5760", "--listen", "127.0.0.1:0")
    _, stderr = await asyncio.wait_for(process.communicate(), 20)
    assert process.returncode == 1
    assert stderr.decode().splitlines()[-1].startswith("aps: the daemon failed: ")
