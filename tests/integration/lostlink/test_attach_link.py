"""Packets between an interface and the bus: out to the node's host, in at the wall time of their arrival."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import AsyncIterator
from dataclasses import dataclass, field
from ipaddress import IPv4Address, IPv4Network
from time import monotonic

import pytest

from bridge.bus.keys import Keys
from bridge.bus.messages import Clock, Header
from bridge.bus.reception import UNKNOWN, Instants, attachment
from bridge.bus.session import Session, Stamp, free_port, open_client, open_router
from lostlink.attach import run_clock
from lostlink.attach.forwarder import Dropped, Forwarder
from lostlink.attach.link import IpLink
from tests.unit.lostlink.attach.packets import ip_packet

KEYS = Keys("r1")
MS = 1_000_000
WAIT_S = 10.0


@dataclass
class Bench:
    """The link of node 0, between a socket in the place of an interface and a router."""

    router: Session
    interface: socket.socket
    forwarder: Forwarder
    entered: asyncio.Queue[tuple[str, bytes]] = field(default_factory=asyncio.Queue)
    ended: asyncio.Event = field(default_factory=asyncio.Event)
    link: IpLink = field(init=False)

    def tick(self, tick_ns: int, speed: float = 1.0) -> None:
        self.router.put(KEYS.clock, Clock(Header.at(tick_ns, ""), speed))

    def delivers(
        self, raw: bytes, arrived_ns: int | None = None, radio: str = "main", channel: str = "ip"
    ) -> None:
        instants = UNKNOWN if arrived_ns is None else Instants(0, 0, 0, arrived_ns)
        told = attachment(Stamp(1, 0).to_bytes(), -80.0, 10.0, instants, radio)
        self.router.put_bytes(KEYS.rx("0", "1", channel), raw, attachment=told)

    async def comes(self) -> tuple[bytes, float]:
        """The next packet at the interface, and when it came."""
        async with asyncio.timeout(WAIT_S):
            raw = await asyncio.get_running_loop().sock_recv(self.interface, 65536)
        return raw, monotonic()


@pytest.fixture
async def bench() -> AsyncIterator[Bench]:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    addresses = {"0": IPv4Address("10.42.0.1"), "1": IPv4Address("10.42.0.2")}
    forwarder = Forwarder("0", addresses, IPv4Network("10.42.0.0/24"), 600)
    with open_router(endpoint) as router, open_client(endpoint, timeout_s=WAIT_S) as client, ours, theirs:
        for side in (ours, theirs):
            side.setblocking(False)
        bench = Bench(router, theirs, forwarder)
        loop = asyncio.get_running_loop()

        def on_enter(sample: object) -> None:
            item = str(sample.key_expr), sample.payload.to_bytes()  # type: ignore[attr-defined]
            loop.call_soon_threadsafe(bench.entered.put_nowait, item)

        router.subscribe(KEYS.enter("0", "*", to="*", radio="*"), on_enter)
        wanted = router.interest(KEYS.clock_end)
        link = IpLink(client, KEYS, "0", "main", forwarder, ours.fileno(), bench.ended.set)
        link.open()
        bench.link = link
        async with asyncio.timeout(WAIT_S):
            while not wanted():  # noqa: ASYNC110
                await asyncio.sleep(0.01)
        yield bench
        link.close()


async def test_what_the_program_sends_goes_to_its_host_with_its_addressee(bench: Bench) -> None:
    for raw in (ip_packet("10.42.0.2"), b"\x60garbage", ip_packet("10.42.0.77"), ip_packet("224.0.0.1")):
        bench.interface.send(raw)
    async with asyncio.timeout(WAIT_S):
        assert [await bench.entered.get() for _ in range(2)] == [
            ("lostlink/r1/node/0/enter/main/1/ip", ip_packet("10.42.0.2")),
            ("lostlink/r1/node/0/enter/main/all/ip", ip_packet("224.0.0.1")),
        ]
    assert bench.forwarder.dropped == {Dropped.IPV6: 1, Dropped.NO_NODE: 1}


@pytest.mark.parametrize("speed", [1.0, 4.0])
async def test_what_arrives_between_ticks_comes_when_its_time_has_come(speed: float, bench: Bench) -> None:
    first, second, third = (ip_packet("10.42.0.1", payload) for payload in (b"1", b"2", b"3"))
    bench.tick(1000 * MS, speed)
    began_s = monotonic()
    bench.delivers(first, 1000 * MS)
    bench.delivers(second, 1400 * MS)
    bench.delivers(third, 1800 * MS)
    waits_s = []
    for expected in (first, second, third):
        raw, at_s = await bench.comes()
        assert raw == expected
        waits_s.append(at_s - began_s)
    assert waits_s[0] < 0.3 / speed
    assert waits_s[1] >= 0.4 / speed - 0.05
    assert waits_s[2] >= 0.8 / speed - 0.05


async def test_packets_of_others_do_not_come(bench: Bench) -> None:
    mine = ip_packet("10.42.0.1")
    bench.tick(0)
    bench.delivers(ip_packet("10.42.0.1", b"by another radio"), radio="mesh")
    bench.delivers(ip_packet("10.42.0.1", b"on another channel"), channel="team")
    bench.delivers(b"no packet")
    bench.delivers(mine)
    assert (await bench.comes())[0] == mine
    assert bench.forwarder.dropped == {Dropped.IPV6: 1}


async def test_while_an_operator_holds_the_clock_the_run_is_not_slow(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run_clock, "BEHIND_S", 0.0)
    bench.tick(0)
    bench.router.put(KEYS.clock_pace, Clock(Header.at(0, ""), 1.0, 0.0, paused=True))
    bench.tick(0)  # no sim time in some wall time: too slow, were it not held
    bench.delivers(ip_packet("10.42.0.1"))
    await bench.comes()
    assert bench.link.clock.warning == ""
    bench.router.put(KEYS.clock_pace, Clock(Header.at(0, ""), 1.0))
    for _ in range(2):
        bench.tick(0)
    bench.delivers(ip_packet("10.42.0.1"))
    await bench.comes()
    assert bench.link.clock.warning


async def test_the_end_of_the_run_is_told(bench: Bench) -> None:
    assert not bench.ended.is_set()
    bench.router.put(KEYS.clock_end, Header.at(5, ""))
    async with asyncio.timeout(WAIT_S):
        await bench.ended.wait()
