"""One client's abuse must not be noticed by the others: processes, sockets, and a witness's clock."""

import asyncio
import gc
import json
import socket
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from aps.daemon import Daemon, DaemonConfig
from benchmarks.aps import bench_aps_routers
from benchmarks.aps.aps_sources import RATE_HZ
from benchmarks.aps.bench_aps_fairness import ABUSES, LIMIT_GAP_MS, LIMIT_GROWTH_MB, measure

HEARTBEAT = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)

ROOT = Path(__file__).parents[3]


@pytest.fixture
def own_heap():
    """The collector looks at what the test makes, not at all that the tests before it left in this process (0.3 s)."""
    gc.collect()
    gc.freeze()
    yield
    gc.unfreeze()


def abuses(*short: str) -> list[Any]:
    """All abuses; those but the ones that are named are for long tests."""
    rest = (pytest.param(name, marks=pytest.mark.long) for name in ABUSES if name not in {"nobody", *short})
    return [*short, *rest]


@pytest.mark.slow
@pytest.mark.parametrize("autopilot", [pytest.param("clock", marks=pytest.mark.long), "standin"])
@pytest.mark.parametrize("abuse", abuses("0xFD", "0xFE", "stall", "connections"))
def test_a_witness_loses_nothing_to_an_abuser(abuse, autopilot):
    row = measure(abuse, 3.0, autopilot)
    assert row["growth_mb"] < LIMIT_GROWTH_MB
    assert row["messages"] > 3.5 * RATE_HZ
    assert row["counted"][SHOWN[abuse]] > 0
    if "control_gap_ms" in row:  # what a busy machine costs without a daemon is not the daemon's
        assert row["gap_ms"] < max(LIMIT_GAP_MS, row["control_gap_ms"] + LIMIT_GAP_MS - 1000.0 / RATE_HZ)


@pytest.mark.slow
@pytest.mark.parametrize("abuse", abuses("heartbeats", "stall"))
async def test_no_turn_of_the_event_loop_takes_long(autopilot, connect, abuse, own_heap):
    """What a turn computes, in CPU time: on a machine that is not overloaded, nobody waits longer than that."""
    async with Daemon(DaemonConfig(autopilot=f"tcp:127.0.0.1:{autopilot.port}", sysid=2)) as daemon:
        await asyncio.wait_for(daemon.wait_heard(), 10)
        witness = await connect(daemon.listen_port)
        await witness.next("ATTITUDE")
        arguments = ("--role", abuse, "--port", str(daemon.listen_port), "--seconds", "1.5")
        process = await asyncio.create_subprocess_exec(
            *(sys.executable, "-m", "benchmarks.aps.bench_aps_fairness", *arguments),
            cwd=ROOT,
            stdin=asyncio.subprocess.DEVNULL,  # it need not wait
        )
        turns_ms, done = [], asyncio.create_task(process.wait())
        before_ns = time.thread_time_ns()
        while not done.done():
            await asyncio.sleep(0)
            now_ns = time.thread_time_ns()
            turns_ms.append((now_ns - before_ns) / 1e6)
            before_ns = now_ns
        assert max(turns_ms) < LIMIT_GAP_MS / 2
        assert (await witness.next("ATTITUDE")).get_srcSystem() == 2
        totals = daemon.statistics()
        shown = {**totals["client_totals"], "turned_away": totals["turned_away"]}
        assert shown[SHOWN[abuse]] > 0


@pytest.mark.slow
def test_the_benchmark_of_routers_in_short(capsys):
    bench_aps_routers.main(["--rounds", "1", "--seconds", "1"])
    told = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert told["routers"]["aps"]["arrived"] > 0.99
    assert 0.0 < told["idle_cores"] < bench_aps_routers.LIMIT_CORES


SHOWN = {
    "0xFD": "throttled",
    "0xFE": "throttled",
    "heartbeats": "throttled",
    "stall": "frames_out",
    "connections": "turned_away",
}
"""Abuse -> its counter; who stalls for a second and a half has not filled its socket yet."""


@pytest.fixture
async def daemon(autopilot):
    config = DaemonConfig(
        autopilot=f"tcp:127.0.0.1:{autopilot.port}", sysid=2, client_frames_per_s=100.0, max_clients=8
    )
    async with Daemon(config) as daemon:
        await asyncio.wait_for(daemon.wait_heard(), 10)
        yield daemon


async def test_client_that_floods_waits_and_is_counted(daemon, connect, eventually, caplog):
    client = await connect(daemon.listen_port)
    raw = b"".join(bytes(HEARTBEAT.pack(client.mav)) for _ in range(2000))
    before_s = asyncio.get_running_loop().time()
    client.writer.write(raw[: 250 * 21])
    await eventually(lambda: daemon.statistics()["client_totals"]["frames_in"] == 250)  # nothing is lost
    assert asyncio.get_running_loop().time() - before_s > 0.9  # of 250, 50 may come at once
    totals = daemon.statistics()["client_totals"]
    assert totals["throttled"] >= 1
    assert "sends more than it may: it has to wait" in caplog.text
    client.close()
    await eventually(lambda: not daemon.links.clients)
    assert daemon.statistics()["client_totals"]["frames_in"] == 250  # of those that have left, too


async def test_datagrams_beyond_the_allowance_are_dropped_and_counted(daemon, make_udp_peer, eventually):
    listener = await daemon.open("udp-in:127.0.0.1:0")
    peer = await make_udp_peer(("127.0.0.1", listener.port))
    for _ in range(200):
        peer.send_raw(bytes(HEARTBEAT.pack(peer.mav)))
    await eventually(lambda: daemon.statistics()["client_totals"].get("dropped_rate", 0) >= 100)
    assert 50 <= daemon.statistics()["client_totals"]["frames_in"] <= 100


async def test_garbage_counts_against_the_allowance(daemon, connect, eventually):
    client = await connect(daemon.listen_port)
    client.writer.write(bytes(8192))
    await eventually(lambda: daemon.statistics()["client_totals"]["throttled"] >= 1)
    assert daemon.statistics()["client_totals"]["skipped_bytes"] >= 4096


async def test_a_reader_that_stalled_gets_the_newest_when_it_reads_again(daemon, autopilot, eventually):
    stalled = socket.socket()
    stalled.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    stalled.connect(("127.0.0.1", daemon.listen_port))
    await eventually(lambda: len(daemon.links.clients) == 1)
    (link,) = daemon.links.clients.values()
    number = 0
    while not link.outbox.counters.stalls or number < 20_000:
        for _ in range(100):
            autopilot.send(mavlink.MAVLink_named_value_int_message(number, b"n", number))
            number += 1
        await asyncio.sleep(0.005)
    stalled.setblocking(False)
    mav = mavlink.MAVLink(None)
    mav.robust_parsing = True
    got = []
    while not got or got[-1] < number - 1:
        data = await asyncio.wait_for(asyncio.get_running_loop().sock_recv(stalled, 4096), 10)
        messages = mav.parse_buffer(data) or []
        got += [message.value for message in messages if message.get_type() == "NAMED_VALUE_INT"]
    stalled.close()
    jump = max(range(1, len(got)), key=lambda at: got[at] - got[at - 1])
    assert got[jump] - got[jump - 1] > number / 2  # the backlog was dropped ...
    assert len(got) - jump < 500  # ... but for the newest
    assert link.outbox.counters.dropped_full > number / 2


async def test_clients_beyond_the_limit_are_counted_and_the_log_is_not_flooded(
    daemon, connect, eventually, caplog
):
    good = await connect(daemon.listen_port)
    crowd = [await asyncio.open_connection("127.0.0.1", daemon.listen_port) for _ in range(60)]
    await eventually(lambda: daemon.statistics()["turned_away"] == 53)
    assert (await good.next("ATTITUDE")).get_srcSystem() == 2
    assert caplog.text.count("turned away") == 1
    for _, writer in crowd:
        writer.transport.abort()
