"""Endpoints at real devices and sockets: who comes and goes, who is held, who does not read."""

from __future__ import annotations

import asyncio
import contextlib
import os
import pty
import socket
from collections.abc import Callable
from pathlib import Path

import pytest

from bridge.endpoints import line, tcp
from bridge.endpoints.address import endpoint_of
from bridge.endpoints.endpoint import Endpoint
from bridge.endpoints.tcp import UNREAD_BYTES
from bridge.host.modem_devices import GroundPort
from tests.unit.bridge.modem.frames import heartbeat

MS = 1_000_000
SOON_S = 0.01
LONG_S = 20.0


class Seen:
    """What an endpoint gave and told."""

    def __init__(self, endpoint: Endpoint) -> None:
        self.data, self.told = b"", list[str]()
        self._changed = asyncio.Event()
        endpoint.on_data, endpoint.tell = self._came, self._tell

    def _came(self, data: bytes, _: object) -> None:
        self.data += data
        self._changed.set()

    def _tell(self, text: str) -> None:
        self.told.append(text)
        self._changed.set()

    async def until(self, is_so: Callable[[], bool]) -> None:
        async with asyncio.timeout(LONG_S):
            while not is_so():
                self._changed.clear()
                await self._changed.wait()


def port_of(endpoint: Endpoint) -> int:
    return int(endpoint.name.rpartition(":")[2])


async def read(connection: socket.socket, count: int) -> bytes:
    """So many bytes of a socket, while the loop goes on."""
    connection.setblocking(False)
    found = b""
    async with asyncio.timeout(LONG_S):
        while len(found) < count:
            found += await asyncio.get_running_loop().sock_recv(connection, count - len(found))
    return found


def filled(write: Callable[[], int]) -> int:
    """Write until no more is taken; how many bytes that was."""
    sent = 0
    while True:
        try:
            sent += write()
        except BlockingIOError:
            return sent


def stuff(connection: socket.socket) -> int:
    """Send all that a socket takes."""
    connection.setblocking(False)
    return filled(lambda: connection.send(bytes(1 << 16)))


async def test_programs_come_to_a_pseudo_terminal_and_go() -> None:
    endpoint = endpoint_of("pty")
    seen = Seen(endpoint)
    await endpoint.open()
    for text in (b"one", b"two"):
        device = os.open(endpoint.name, os.O_RDWR | os.O_NOCTTY)
        os.write(device, text)
        await seen.until(lambda text=text: seen.data.endswith(text))  # type: ignore[misc]
        endpoint.write(text[::-1])
        assert os.read(device, 100) == text[::-1]
        os.close(device)
    assert (seen.data, seen.told, endpoint.unread_bytes) == (b"onetwo", [], 0)
    await endpoint.close()


async def test_a_pseudo_terminal_that_is_held_is_not_read_and_one_that_is_not_read_counts() -> None:
    endpoint = endpoint_of("pty")
    seen = Seen(endpoint)
    await endpoint.open()
    device = os.open(endpoint.name, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    endpoint.hold()
    sent = filled(lambda: os.write(device, bytes(1000)))
    assert sent > 0
    await asyncio.get_running_loop().run_in_executor(None, os.stat, endpoint.name)  # the loop has gone round
    assert seen.data == b""
    endpoint.go_on()
    await seen.until(lambda: len(seen.data) == sent)
    written = 0
    while not endpoint.unread_bytes:
        endpoint.write(b"x" * 1000)
        written += 1000
    got = b""
    while len(got) < written - endpoint.unread_bytes:
        got += os.read(device, 1000)
    assert set(got) == set(b"x")
    os.close(device)
    await endpoint.close()


async def test_whoever_opens_a_pseudo_terminal_late_reads_the_newest() -> None:
    endpoint = endpoint_of("pty")
    await endpoint.open()
    lines = [b"%07d\n" % number for number in range(20_000)]
    for each in lines:
        endpoint.write(each)
    device = os.open(endpoint.name, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    got = b""
    with contextlib.suppress(BlockingIOError):
        while True:
            got += os.read(device, 1 << 16)
    assert b"".join(lines).endswith(got)
    assert 0 < len(got) == 8 * len(lines) - endpoint.unread_bytes
    os.close(device)
    await endpoint.close()


async def test_a_serial_line_that_goes_is_opened_again_when_it_is_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(line, "LONGEST_RETRY_S", SOON_S)
    device = tmp_path / "ttyUSB0"
    adapter, other = pty.openpty()
    device.symlink_to(os.ttyname(other))
    endpoint = endpoint_of(f"serial:{device}:57600")
    seen = Seen(endpoint)
    await endpoint.open()
    os.write(adapter, b"before")
    await seen.until(lambda: seen.data == b"before")
    os.close(other)
    device.unlink()
    os.close(adapter)
    await seen.until(lambda: len(seen.told) == 1)
    endpoint.write(b"nobody")
    assert endpoint.unread_bytes == 6
    adapter, other = pty.openpty()
    device.symlink_to(os.ttyname(other))
    await seen.until(lambda: len(seen.told) == 2)
    assert seen.told == [f"{endpoint.name} has gone: plug it in again", f"{endpoint.name} is back"]
    os.write(adapter, b" after")
    await seen.until(lambda: seen.data == b"before after")
    assert endpoint.connections == 2
    await endpoint.close()
    for fd in (adapter, other):
        os.close(fd)


async def test_a_station_that_is_held_fills_its_own_socket_and_loses_nothing() -> None:
    endpoint = endpoint_of("tcpin:127.0.0.1:0")
    seen = Seen(endpoint)
    await endpoint.open()
    with socket.create_connection(("127.0.0.1", port_of(endpoint))) as station:
        station.sendall(b"here")
        await seen.until(lambda: seen.data == b"here")
        endpoint.hold()
        sent = stuff(station)
        sent += await asyncio.get_running_loop().run_in_executor(None, stuff, station)
        assert seen.data == b"here"
        endpoint.go_on()
        await seen.until(lambda: len(seen.data) == 4 + sent)
    await endpoint.close()


async def test_little_is_kept_for_a_station_that_does_not_read_and_others_get_all() -> None:
    endpoint = endpoint_of("tcpin:127.0.0.1:0")
    seen = Seen(endpoint)
    await endpoint.open()
    stations = [socket.create_connection(("127.0.0.1", port_of(endpoint))) for _ in range(2)]
    for station in stations:
        station.sendall(b".")
    await seen.until(lambda: seen.data == b"..")
    piece = bytes(1 << 14)
    for _ in range(1000):  # 16 MB, more than kernels keep
        endpoint.write(piece)
        assert await read(stations[0], len(piece)) == piece
    buffers = [stream.transport.get_write_buffer_size() for stream in endpoint._streams]  # type: ignore[attr-defined]
    assert 0 < max(buffers) < UNREAD_BYTES + len(piece)
    assert endpoint.unread_bytes == 0, "somebody took it"
    stations[0].close()
    await endpoint.close()
    stations[1].close()


async def test_a_connection_is_made_when_somebody_listens_and_again_when_it_is_lost(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(tcp, "FIRST_RETRY_S", SOON_S)
    with socket.socket() as place:
        place.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        place.bind(("127.0.0.1", 0))
        endpoint = endpoint_of(f"tcp:127.0.0.1:{place.getsockname()[1]}")
        seen = Seen(endpoint)
        await endpoint.open()
        await seen.until(lambda: len(seen.told) == 1)
        assert "start it, it is tried again and again" in seen.told[0]
        endpoint.write(b"nobody")
        assert endpoint.unread_bytes == 6
        place.listen()
        place.setblocking(False)
        for count in (1, 2):
            host, _ = await asyncio.wait_for(asyncio.get_running_loop().sock_accept(place), LONG_S)
            host.sendall(b"x" * count)
            await seen.until(lambda count=count: len(seen.data) == (1, 3)[count - 1])  # type: ignore[misc]
            endpoint.write(b"hello")
            assert await read(host, 5) == b"hello"
            host.close()
        await endpoint.close()
    assert endpoint.connections == 2


async def test_a_udp_port_answers_whoever_spoke_last() -> None:
    endpoint = endpoint_of("udpin:127.0.0.1:0")
    seen = Seen(endpoint)
    await endpoint.open()
    endpoint.write(b"nobody")
    assert endpoint.unread_bytes == 6
    for count in (1, 2):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
            station.sendto(b"x", ("127.0.0.1", port_of(endpoint)))
            await seen.until(lambda count=count: len(seen.data) == count)  # type: ignore[misc]
            endpoint.write_all([b"ab", b"c"])
            assert [await read(station, 2), await read(station, 1)] == [b"ab", b"c"]
    assert endpoint.connections == 2
    await endpoint.close()


async def test_what_is_sent_to_a_udp_port_where_nobody_is_counts_as_unread() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
        station.bind(("127.0.0.1", 0))
        port = station.getsockname()[1]
    endpoint = endpoint_of(f"udp:127.0.0.1:{port}")
    await endpoint.open()
    for pieces, unread_bytes in (([b"ab"], 2), ([b"abc", b"d", b"ef"], 8)):
        endpoint.write_all(pieces)
        endpoint.write_all([])  # a link's next step may come before the refusal does
        async with asyncio.timeout(LONG_S):
            while endpoint.unread_bytes < unread_bytes:  # noqa: ASYNC110
                await asyncio.sleep(0.001)
        assert endpoint.unread_bytes == unread_bytes
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
        station.bind(("127.0.0.1", port))
        endpoint.write_all([b"ab", b"c"])
        assert [await read(station, 2), await read(station, 1)] == [b"ab", b"c"]
    assert endpoint.unread_bytes == 8
    await endpoint.close()


async def test_a_udp_station_that_floods_leaves_one_at_tcp_its_half() -> None:
    """Half of what 57600 baud carry is that of the station that is held, frame by frame."""
    endpoints = [endpoint_of("udpin:127.0.0.1:0"), endpoint_of("tcpin:127.0.0.1:0")]
    port = GroundPort(endpoints, 57_600, 50 * MS)
    await port.open()
    floods, waits = socket.socket(socket.AF_INET, socket.SOCK_DGRAM), socket.socket()
    waits.connect(("127.0.0.1", port_of(endpoints[1])))
    ours, theirs = heartbeat(sysid=1), heartbeat(sysid=2)
    waits.sendall(ours * 800)
    heard = b""
    async with asyncio.timeout(LONG_S):
        while not (endpoints[1].is_held and heard):
            floods.sendto(theirs * 20, ("127.0.0.1", port_of(endpoints[0])))
            await asyncio.sleep(0)
            heard += port.read() if endpoints[1].is_held else b""
        heard = b""
        while len(heard) < 5760:
            floods.sendto(theirs * 20, ("127.0.0.1", port_of(endpoints[0])))
            await asyncio.sleep(0)
            heard += port.read()
    assert heard.count(ours) * len(ours) == pytest.approx(5760 / 2, rel=0.1)
    port.write([b"for all"])
    assert await read(waits, 7) == await read_from(floods) == b"for all"
    for station in (floods, waits):
        station.close()
    await port.close()


async def test_clients_of_one_port_are_heard_frame_by_frame() -> None:
    endpoint = endpoint_of("tcpin:127.0.0.1:0")
    port = GroundPort([endpoint], 57_600, 50 * MS)
    await port.open()
    place = ("127.0.0.1", port_of(endpoint))
    with socket.create_connection(place) as alice, socket.create_connection(place) as bob:
        ours, theirs = heartbeat(sysid=1), heartbeat(sysid=2)
        heard = b""
        async with asyncio.timeout(LONG_S):
            while endpoint.hosts < 2:  # noqa: ASYNC110 (nothing tells)
                await asyncio.sleep(0)
            for station, part in ((alice, ours[:10]), (bob, theirs), (alice, ours[10:]), (bob, theirs)):
                station.sendall(part)
                before = heard
                while part != ours[:10] and heard == before:
                    await asyncio.sleep(0)
                    heard += port.read()
        assert heard == theirs + ours + theirs
    await port.close()


async def read_from(station: socket.socket) -> bytes:
    station.setblocking(False)
    return await asyncio.wait_for(asyncio.get_running_loop().sock_recv(station, 100), LONG_S)


async def test_a_port_takes_so_many_hosts_and_no_more(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tcp, "HOSTS_MAX", 2)
    endpoint = endpoint_of("tcpin:127.0.0.1:0")
    seen = Seen(endpoint)
    await endpoint.open()
    try:
        hosts = []
        for _ in range(3):
            hosts.append(await asyncio.open_connection("127.0.0.1", port_of(endpoint)))
        with contextlib.suppress(ConnectionResetError):
            assert await asyncio.wait_for(hosts[2][0].read(), LONG_S) == b""
        assert (endpoint.hosts, endpoint.connections) == (2, 2)
        hosts[1][1].write(b"x")
        await seen.until(lambda: seen.data == b"x")
    finally:
        for _, writer in hosts:
            writer.close()
        await endpoint.close()
