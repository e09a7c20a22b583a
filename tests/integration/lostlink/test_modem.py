"""A pair of modems in wall time: real sockets, a pseudo-terminal, programs that come and go, the command itself."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import re
import signal
import socket
import sys
from asyncio.subprocess import PIPE, STDOUT, Process
from collections.abc import AsyncIterator
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from aps.wire.framer import Framer
from lostlink.modem.live import IDLE_NS, LiveLink
from lostlink.testing.modem_link import ModemLinks
from tests.unit.bridge.modem.frames import decoded, frame_of, heartbeat

pytestmark = pytest.mark.timeout(120)

NEAR = {"radio": "sik-433", "distance_m": 50.0, "settings": ("radio.bursts.model=none",)}
HOME = "47.3977,8.5456,488,90"


def port_of(name: str) -> int:
    return int(name.rpartition(":")[2])


@contextlib.asynccontextmanager
async def dialled(name: str) -> AsyncIterator[tuple[asyncio.StreamReader, asyncio.StreamWriter]]:
    """A connection to an endpoint that listens."""
    reader, writer = await asyncio.open_connection("127.0.0.1", port_of(name))
    try:
        yield reader, writer
    finally:
        writer.close()
        with contextlib.suppress(ConnectionError):
            await writer.wait_closed()


async def frames(reader: asyncio.StreamReader, count: int) -> list[bytes]:
    """The next frames that are no RADIO_STATUS."""
    framer, found = Framer(), []
    async with asyncio.timeout(30):
        while len(found) < count:
            data = await reader.read(4096)
            assert data, "the link closed"
            found += [frame.raw for frame in framer.receive(data) if frame.msg_id != 109]
    return found


async def test_frames_go_both_ways_between_tcp_clients(modem_link: ModemLinks) -> None:
    async with (
        modem_link.open(**NEAR) as link,
        dialled(link.gcs) as (ground, say_up),
        dialled(link.autopilot) as (air, say_down),
    ):
        sent = [frame_of(60, n) for n in range(30)]
        say_down.write(b"".join(sent))
        say_up.write(heartbeat(7))
        assert await frames(ground, 30) == sent
        assert await frames(air, 1) == [heartbeat(7)]
        told = link.summary()
        assert (told["down"]["frames_in"], told["down"]["frames_out"], told["down"]["loss"]) == (30, 30, 0.0)
        assert (told["up"]["frames_in"], told["up"]["frames_out"]) == (1, 1)


async def test_the_summary_has_the_causes_of_the_record(modem_link: ModemLinks) -> None:
    """The station's modem tells its status when the heartbeat was on the air, and so was lost."""
    settings = ["radio.base_loss=1", "radio.bursts.model=none"]
    async with (
        modem_link.open(radio="sik-433", distance_m=20, settings=settings) as link,
        dialled(link.gcs) as (ground, say_up),
        asyncio.timeout(30),
    ):
        say_up.write(heartbeat())
        await ground.readexactly(21)
        told = link.summary()["up"]
        assert (told["loss"], told["lost"]) == (1.0, {"base_loss": 1})


async def test_the_autopilot_may_restart(modem_link: ModemLinks) -> None:
    came: asyncio.Queue[asyncio.StreamWriter] = asyncio.Queue()
    server = await asyncio.start_server(lambda _, writer: came.put_nowait(writer), "127.0.0.1", 0)
    port = server.sockets[0].getsockname()[1]
    async with modem_link.open(autopilot=f"tcp::{port}", **NEAR) as link, dialled(link.gcs) as (ground, _):
        for n in range(2):
            async with asyncio.timeout(30):
                autopilot = await came.get()
            autopilot.write(frame_of(50, n))
            assert await frames(ground, 1) == [frame_of(50, n)]
            autopilot.transport.abort()
            with contextlib.suppress(ConnectionError):
                await autopilot.wait_closed()
    server.close()


async def test_a_link_that_is_closed_stays_so(
    modem_link: ModemLinks, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A datagram that was in the socket as it closed brings nothing back to life."""
    lived = 0
    live = LiveLink._live

    def counted(link: LiveLink) -> None:
        nonlocal lived
        lived += 1
        live(link)

    monkeypatch.setattr(LiveLink, "_live", counted)
    async with modem_link.open("tcpin::0", "udpin::0", **NEAR) as link:
        with socket.socket(type=socket.SOCK_DGRAM) as sender:
            sender.sendto(heartbeat(), ("127.0.0.1", port_of(link.autopilot)))
    before = lived
    later = asyncio.get_running_loop().create_future()
    asyncio.get_running_loop().call_later(2 * IDLE_NS / 1e9, later.set_result, None)
    await later
    assert lived == before


async def test_udp_both_ways(modem_link: ModemLinks) -> None:
    with socket.socket(type=socket.SOCK_DGRAM) as station, socket.socket(type=socket.SOCK_DGRAM) as autopilot:
        for one in (station, autopilot):
            one.setblocking(False)
            one.bind(("127.0.0.1", 0))
        port = station.getsockname()[1]
        loop = asyncio.get_running_loop()
        async with modem_link.open(f"udp::{port}", "udpin::0", **NEAR) as link, asyncio.timeout(30):
            place = ("127.0.0.1", port_of(link.autopilot))
            await loop.sock_sendto(autopilot, frame_of(50, 1), place)
            data, back = await loop.sock_recvfrom(station, 2048)
            assert data == frame_of(50, 1)
            await loop.sock_sendto(station, heartbeat(2), back)
            assert await loop.sock_recv(autopilot, 2048) == heartbeat(2)


async def test_a_pseudo_terminal(modem_link: ModemLinks) -> None:
    async with (
        modem_link.open("pty", "tcpin::0", **NEAR) as link,
        dialled(link.autopilot) as (air, say_down),
    ):
        line = os.open(link.gcs, os.O_RDWR | os.O_NOCTTY)
        os.write(line, heartbeat(1))
        assert await frames(air, 1) == [heartbeat(1)]
        say_down.write(frame_of(80, 4))
        heard = b""
        async with asyncio.timeout(30):
            while frame_of(80, 4) not in heard:
                heard += await asyncio.to_thread(os.read, line, 4096)
        assert [m.get_type() for m in decoded(heard)] == ["RADIO_STATUS", "FILE_TRANSFER_PROTOCOL"]
        os.close(line)


@pytest.mark.slow
async def test_a_host_that_floods_waits_and_loses_nothing(modem_link: ModemLinks) -> None:
    """Without a limit of the air, TCP hosts are held back by their line, as at a UART: all bytes come, at its rate."""
    loop = asyncio.get_running_loop()
    async with (
        modem_link.open(radio="perfect", baud=57_600) as link,
        dialled(link.gcs) as (ground, _),
        dialled(link.autopilot) as (_, say_down),
    ):
        began_s = loop.time()
        sent = [frame_of(200, n) for n in range(87)]
        say_down.write(b"".join(sent))
        assert await frames(ground, len(sent)) == sent
        assert loop.time() - began_s >= 87 * 200 * 10 / 57_600 - 0.01


@contextlib.asynccontextmanager
async def child(*words: str, **options: object) -> AsyncIterator[Process]:
    process = await asyncio.create_subprocess_exec(sys.executable, "-m", *words, stdout=PIPE, **options)  # type: ignore[arg-type]
    try:
        yield process
    finally:
        if process.returncode is None:
            process.kill()
        await process.communicate()


async def says(reader: asyncio.StreamReader | None, pattern: str) -> str:
    assert reader is not None
    told = ""
    async with asyncio.timeout(60):
        while (found := re.search(pattern, told)) is None:
            line = await reader.readline()
            assert line, told
            told += line.decode()
    return found[1]


@pytest.mark.slow
async def test_the_command_between_a_station_and_a_standin(tmp_path: Path) -> None:
    fdm = ("fdm", "--home", HOME, "--port=0", "--speed=1")
    away = tmp_path / "away.csv"
    away.write_text("time_s,distance_m\n0,50\n600,60\n")
    async with contextlib.AsyncExitStack() as stack:
        physics = await stack.enter_async_context(child(*fdm, stderr=STDOUT))
        physics_port = await says(physics.stdout, r"UDP 127\.0\.0\.1:(\d+)")
        words = (
            "standin",
            "--sysid=2",
            f"--fdm-port={physics_port}",
            "--mavlink-port=0",
            "--home",
            HOME,
        )
        autopilot = await stack.enter_async_context(child(*words, stderr=STDOUT))
        port = await says(autopilot.stdout, r"tcp:127\.0\.0\.1:(\d+)")
        command = ["lostlink", "modem", "--gcs", "tcpin::0", "--autopilot", f"tcp::{port}"]
        command += ["--distances", str(away), "--seed", "7", "--json", "--set", "radio.bursts.model=none"]
        link = await stack.enter_async_context(child(*command, stderr=PIPE))
        ground_port = await says(link.stderr, r"ready: ground station at tcpin:127\.0\.0\.1:(\d+)")
        async with dialled(f":{ground_port}") as station:
            counts = await fetch_parameters(*station)
        assert counts["PARAM_VALUE"] >= 21
        assert counts["HEARTBEAT"] >= 1
        assert counts["RADIO_STATUS"] >= 1
        link.send_signal(signal.SIGINT)
        out, err = await link.communicate()
        assert link.returncode == 0, err
        told = json.loads(out)
        assert (told["radio"], told["seed"]) == ("sik-433", 7)
        assert told["down"]["frames_out"] >= counts["PARAM_VALUE"] + counts["HEARTBEAT"]
        assert told["up"]["frames_out"] >= 2
        assert told["up"]["radio_status"] >= counts["RADIO_STATUS"]


async def fetch_parameters(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> dict[str, int]:
    """All parameters, by list and one by one, as stations do, and a heartbeat; what came by type."""
    mav = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
    mav.robust_parsing = True
    counts = dict.fromkeys(("PARAM_VALUE", "HEARTBEAT", "RADIO_STATUS"), 0)
    missing: set[int] = set()
    writer.write(mavlink.MAVLink_param_request_list_message(2, 1).pack(mav))
    async with asyncio.timeout(60):
        while missing or not all(counts.values()):
            writer.write(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(mav))
            for index in list(missing)[:5]:
                writer.write(mavlink.MAVLink_param_request_read_message(2, 1, b"", index).pack(mav))
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(1.0):
                    while missing or not all(counts.values()):
                        for message in mav.parse_buffer(await reader.read(4096)) or []:
                            kind = message.get_type()
                            if kind == "PARAM_VALUE":
                                missing |= set() if counts[kind] else set(range(message.param_count))
                                missing.discard(message.param_index)
                            if kind in counts:
                                counts[kind] += 1
    return counts


def refused(*words: str) -> tuple[int, str]:
    from click.testing import CliRunner

    from lostlink.cli.live.modem import modem

    done = CliRunner().invoke(modem, words)
    return done.exit_code, done.output


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--gcs", "pty"], "Missing option '--autopilot'"),
        (["--gcs", "pipe", "--autopilot", "pty"], "'pipe' is none of tcp:HOST:PORT"),
        (["--gcs", "tcp:nowhere", "--autopilot", "pty"], "'tcp:nowhere' is not tcp:HOST:PORT"),
        (["--gcs", "pty", "--autopilot", "pty", "--radio", "sik-434"], "did you mean sik-433"),
        (["--gcs", "pty", "--autopilot", "pty", "--set", "seed=4"], "only the radio can be changed"),
        (["--gcs", "pty", "--autopilot", "pty", "--distance", "5", "--distances", __file__], "choose one"),
        (["--gcs", "pty", "--autopilot", "pty", "--distances", __file__], "has to name the columns"),
        (["--gcs", "pty", "--autopilot", "pty", "--nodes", "0,1"], "needs --run"),
        (["--gcs", "pty", "--autopilot", "pty", "--run", "x", "--seed", "3"], "--seed: the recorded run"),
        (["--gcs", "pty", "--autopilot", "pty", "--run", "nowhere"], "nowhere is not the directory of a run"),
        (["--gcs", "tcpin:a..b:5760", "--autopilot", "pty"], "'a..b' is not the name of a host"),
        (["--gcs", "pty", "--autopilot", "tcp:a..b:5760"], "'a..b' is not the name of a host"),
        (["--gcs", "pty", "--autopilot", "pty", "--duration", "0"], "--duration 0: above 0"),
        (["--gcs", "pty", "--autopilot", "pty", "--duration", "nan"], "--duration nan: above 0"),
        (["--gcs", "pty", "--autopilot", "pty", "--distance", "1e200"], "a distance of 1e+200 m: from 0 to"),
        (["--gcs", "pty", "--autopilot", "pty", "--heights", "2", "inf"], "heights 2 and inf m: from 0 to"),
        (["--gcs", "pty", "--autopilot", "pty", "--baud", "-1"], "-1 baud"),
        (["--gcs", "pty", "--autopilot", "pty", "--seed", "-1"], "seed -1: from 0 to 9223372036854775807"),
        (["--gcs", "pty", "--autopilot", "pty", "--seed", str(2**63)], "seed 9223372036854775808: from 0 to"),
    ],
)
def test_mistakes_are_named(words: list[str], said: str) -> None:
    status, output = refused(*words)
    assert status == 2
    assert said in output


def test_an_end_that_cannot_be_opened_is_named() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        status, output = refused("--gcs", f"tcpin::{port}", "--autopilot", "pty")
        assert status == 1
        assert output.startswith(f"lostlink: cannot open tcpin:127.0.0.1:{port}: ")
        assert "address already in use; choose another port, or end what has it" in output
    status, output = refused("--gcs", "pty", "--autopilot", "udp:nowhere.invalid:14550")
    assert status == 1
    assert output.startswith("lostlink: cannot open udp:nowhere.invalid:14550: ")
