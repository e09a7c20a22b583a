"""``python -m aps`` as users run it."""

import asyncio
import json
import os
import signal
import sys
import time
import urllib.request

import pytest

from aps.__main__ import main


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


async def test_the_ready_line_has_all_ways_to_the_autopilot(autopilot):
    ways = f"tcp:127.0.0.1:{autopilot.port}", "udp-in:127.0.0.1:0"
    given = [argument for way in ways for argument in ("--autopilot", way)]
    process = await start(*given, "--sysid", "2", "--listen", "127.0.0.1:0")
    assert (await line(process)).split()[4:] == [f"autopilot={way}" for way in ways]
    process.send_signal(signal.SIGTERM)
    assert await asyncio.wait_for(process.wait(), 10) == 0


async def test_the_api_of_a_daemon_from_the_command_line(autopilot):
    process = await start(
        *("--autopilot", f"tcp:127.0.0.1:{autopilot.port}", "--sysid", "2", "--listen", "127.0.0.1:0"),
        *("--api", "127.0.0.1:0"),
    )
    assert (await line(process)).startswith("READY aps")
    name, _, sysid, url = (await line(process)).split()
    assert (name, sysid) == ("API", "sysid=2")
    with await asyncio.to_thread(urllib.request.urlopen, f"{url}state", timeout=10) as reply:
        assert json.load(reply)["sysid"] == 2
    process.send_signal(signal.SIGTERM)
    _, stderr = await asyncio.wait_for(process.communicate(), 10)
    assert process.returncode == 0
    assert b"Traceback" not in stderr


@pytest.mark.parametrize(
    ("place", "says"), [("0.0.0.0:0", "it needs a token"), ("8760", "--api must be HOST:PORT")]
)
async def test_an_api_that_is_open_to_others_without_a_token_is_refused(autopilot, place, says):
    process = await start(
        "--autopilot", f"tcp:127.0.0.1:{autopilot.port}", "--listen=127.0.0.1:0", "--api", place
    )
    stdout, stderr = await asyncio.wait_for(process.communicate(), 20)
    assert process.returncode == 2
    assert stdout == b""
    assert says in stderr.decode()
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


async def test_a_file_of_daemons_with_udp_output_and_tlog(autopilot, make_udp_peer, tmp_path):
    peer = await make_udp_peer()
    file = tmp_path / "daemons.yaml"
    file.write_text(
        f"""
        daemons:
          - autopilot: ["tcp:127.0.0.1:{autopilot.port}"]
            sysid: 2
            tcp_server: [":0", ":0"]
            udp_out: ["127.0.0.1:{peer.port},max-hz=30:5"]
            tlog: {tmp_path / "logs"}
          - {{index: 3, autopilot: ["udp-in::0"], tcp_server: [":0"]}}
        """
    )
    process = await start("--config", str(file))
    ready = [await line(process) for _ in range(2)]
    assert [told.split()[2] for told in ready] == ["sysid=2", "sysid=4"]
    for _ in range(3):  # 5 a second: by then there is something in the log
        await peer.next("ATTITUDE")
    process.terminate()
    _, stderr = await process.communicate()
    assert process.returncode == 0
    assert b"system 2: autopilot on tcp:127.0.0.1:" in stderr
    assert b"system 4: autopilot not heard" in stderr
    (log,) = (tmp_path / "logs").glob("mavlink-2-*.tlog")
    assert log.stat().st_size > 1000


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (
            "daemons: [{sysid: 0}]",
            "daemons.yaml:1: daemons.0.sysid: has to be greater than or equal to 1 (got 0)",
        ),
        ("daemons:\n- {index: 1}\n- {udp: x}", "daemons.yaml:3: daemons.1.udp: unknown key; "),
        ("daemons: [{udp_out: [nowhere]}]", "'udp-out:nowhere' is not udp-out:HOST:PORT"),
        ("[", "daemons.yaml:1: is not YAML: "),
        ("[" * 100_000, "daemons.yaml: is nested too deeply"),
        ("daemons: []\ndaemons: []", "daemons.yaml:2: daemons: given twice, before on line 1"),
    ],
)
def test_mistakes_in_a_file_are_told_with_their_place(tmp_path, content, message, capsys):
    file = tmp_path / "daemons.yaml"
    file.write_text(content)
    assert main(["--config", str(file)]) == 2
    told = capsys.readouterr().err
    assert message in told
    assert "daemons.yaml" in told


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--listen", "127.0.0.1:0", "--serial", "/dev/null:123"], "cannot run at 123 baud"),
        (["--listen", "203.0.113.1:6760"], "cannot listen on 203.0.113.1:6760"),
    ],
)
async def test_a_link_that_cannot_be_is_one_line(arguments, message):
    process = await start(*arguments)
    _, stderr = await asyncio.wait_for(process.communicate(), 20)
    assert process.returncode == 2
    (told,) = stderr.decode().splitlines()
    assert message in told


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--udp-in", "203.0.113.1:6760"], "cannot listen on 203.0.113.1:6760"),
        (["--sysid", "0"], "--sysid must be in 1..255, not 0"),
        (["--index", "-1"], "--index must be in 0..254, not -1"),
        (["--listen", "6760"], "'6760' is not HOST:PORT"),
        (["--autopilot", "udp:127.0.0.1:1"], "'udp:127.0.0.1:1' is not tcp:HOST:PORT"),
        (["--rate-hz", "0"], "--rate-hz must be positive, not 0.0"),
    ],
)
def test_wrong_arguments_are_one_line(arguments, message, capsys):
    assert main(["--listen", "127.0.0.1:0", *arguments]) == 2
    (told,) = capsys.readouterr().err.splitlines()
    assert message in told


def test_help_has_examples(capsys):
    with pytest.raises(SystemExit, match="0"):
        main(["--help"])
    assert (
        "python -m aps --autopilot tcp:127.0.0.1:5760 --sysid 1 --listen 127.0.0.1:6760"
        in capsys.readouterr().out
    )


async def test_a_daemon_that_fails_of_itself_ends_the_program():
    fault = "import socket; socket.getaddrinfo = lambda *_, **__: {}['a resolver with a defect']"
    program = f"{fault}; import sys; from aps.__main__ import main; sys.exit(main())"
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-c", program, "--autopilot", "tcp:gcs.example:5760", "--listen", "127.0.0.1:0"),
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
    )
    _, stderr = await asyncio.wait_for(process.communicate(), 20)
    assert process.returncode == 1
    assert stderr.decode().splitlines()[-1].startswith("aps: the daemon failed: ")


@pytest.mark.parametrize("period", ["nan", "inf", "-1", "0"])
def test_a_period_of_status_that_is_none_is_refused(period, capsys):
    assert main(["status", "--period", period]) == 2
    assert (
        capsys.readouterr().err == f"aps: --period must be above 0 and at most 86400 s, not {float(period)}\n"
    )


@pytest.mark.slow
async def test_status_as_json_ends_with_ctrl_c_without_a_traceback(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))  # daemons of other tests may be ending
    process = await start("status", "--json", "--period=0.05")
    assert json.loads(await line(process)) is not None
    process.send_signal(signal.SIGINT)
    _, stderr = await asyncio.wait_for(process.communicate(), 20)
    assert (process.returncode, stderr) == (0, b"")


@pytest.mark.slow
async def test_a_name_that_no_machine_has_is_told_with_the_link():
    process = await start("--listen", "256.0.0.1:6760", "--quiet")
    _, stderr = await asyncio.wait_for(process.communicate(), 60)
    assert process.returncode == 2
    assert stderr.decode().startswith("aps: cannot listen on tcp-server:256.0.0.1:6760: ")


@pytest.mark.slow
async def test_when_nobody_reads_the_states_any_more_clients_are_served_on(autopilot, connect):
    reading, writing = os.pipe()
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "aps", "--json", "--rate-hz=20", "--sysid=2", "--listen=127.0.0.1:0"),
        *("--autopilot", f"tcp:127.0.0.1:{autopilot.port}"),
        stdout=writing,
        stderr=asyncio.subprocess.PIPE,
    )
    os.close(writing)
    with open(reading, encoding="utf-8") as lines:  # noqa: ASYNC230, PTH123
        ready = json.loads(await asyncio.to_thread(lines.readline))
    while b"the state is printed no more" not in await asyncio.wait_for(process.stderr.readline(), 20):
        pass
    client = await connect(int(ready["listen"].rpartition(":")[2]))
    await client.next("HEARTBEAT", lambda message: message.get_srcComponent() == 1)
    process.send_signal(signal.SIGTERM)
    _, stderr = await asyncio.wait_for(process.communicate(), 20)
    assert process.returncode == 0
    assert b"BrokenPipe" not in stderr
