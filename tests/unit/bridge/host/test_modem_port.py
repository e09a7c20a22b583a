"""The serial side of modems at held instants: what comes when, what is written down, what is repeated."""

from __future__ import annotations

import socket
from collections.abc import Sequence

import pytest

from aps.links.address import parse_autopilot
from aps.links.kinds.held import MAX_WRITE_BYTES, HeldLink
from bridge.endpoints.endpoint import Endpoint
from bridge.host.modem_devices import AutopilotPort, GroundPort
from bridge.host.modem_port import ModemPort
from bridge.record.inputs.file import RecordedInput
from bridge.record.names import Kind
from tests.unit.bridge.modem.frames import heartbeat

MS = 1_000_000


class Host:
    """Something at a serial line."""

    def __init__(self) -> None:
        self.says = b""
        self.heard: list[bytes] = []

    def read(self) -> bytes:
        says, self.says = self.says, b""
        return says

    def write(self, pieces: Sequence[bytes]) -> None:
        self.heard += pieces


class Written:
    """What was written down."""

    def __init__(self) -> None:
        self.serial: list[tuple[Kind, bytes]] = []
        self.inputs: list[RecordedInput] = []

    def write_serial(self, radio: str, kind: Kind, data: bytes) -> None:
        assert radio == "telemetry"
        self.serial.append((kind, data))

    def write_input(self, item: RecordedInput) -> None:
        self.inputs.append(item)


def port_of(host: Host, written: Written, *, is_outside: bool = True) -> ModemPort:
    return ModemPort("telemetry", host, written, is_outside=is_outside)


def test_bytes_come_at_the_first_instant_at_which_they_are_out() -> None:
    host, written = Host(), Written()
    port = port_of(host, written)
    for at_ns, data in ((10 * MS, b"a"), (20 * MS, b"b"), (21 * MS, b"c")):
        port.came(at_ns, data)
    port.exchange(9 * MS)
    assert host.heard == []
    port.exchange(20 * MS)
    assert host.heard == [b"a", b"b"]
    port.exchange(40 * MS)
    assert host.heard == [b"a", b"b", b"c"]
    assert written.serial == [(Kind.FROM_MODEM, b"ab"), (Kind.FROM_MODEM, b"c")]


def test_what_a_host_outside_says_is_an_input_and_an_autopilot_is_not_outside() -> None:
    for is_outside in (True, False):
        host, written = Host(), Written()
        port = port_of(host, written, is_outside=is_outside)
        host.says = b"\xfd\x00"
        assert port.exchange(50 * MS) == b"\xfd\x00"
        assert port.exchange(100 * MS) == b""
        assert written.serial == [(Kind.TO_MODEM, b"\xfd\x00")]
        said = [RecordedInput.serial(50 * MS, "telemetry", b"\xfd\x00")] if is_outside else []
        assert written.inputs == said


def test_a_record_is_repeated_and_nobody_else_is_heard() -> None:
    host, written = Host(), Written()
    port = port_of(host, written)
    inputs = [
        RecordedInput.serial(50 * MS, "telemetry", b"one"),
        RecordedInput.serial(50 * MS, "other", b"no"),
        RecordedInput.serial(100 * MS, "telemetry", b"two"),
    ]
    port.repeat(inputs)
    host.says = b"who is there?"
    assert [port.exchange(at * 50 * MS) for at in range(4)] == [b"", b"one", b"two", b""]
    assert written.inputs == [inputs[0], inputs[2]]


def test_little_waits_for_an_autopilot_that_does_not_read_and_what_it_gets_is_whole() -> None:
    """After as much as the kernel takes and a bound, pieces are dropped as a whole and counted."""
    piece_bytes, reasons = 100, list[str]()
    with socket.create_server(("127.0.0.1", 0)) as listener:
        link = HeldLink(parse_autopilot(f"tcp:127.0.0.1:{listener.getsockname()[1]}"), 1 << 20)
        port = AutopilotPort(link, reasons.append)
        port.read()
        autopilot, _ = listener.accept()
        sent = 0
        while sent < 200 or not port.unread_bytes:
            port.write([bytes([sent % 251]) * piece_bytes for sent in range(sent, sent + 200)])
            sent += 200
            assert link.unsent_bytes <= 200 * piece_bytes
        dropped = port.unread_bytes
        port.write([b"x" * piece_bytes] * 200)
        assert port.unread_bytes > dropped
        assert link.unsent_bytes <= 200 * piece_bytes
        assert set(reasons) == {"its autopilot does not read a serial port with a modem"}
        with autopilot:
            autopilot.settimeout(10.0)
            due, got = (sent + 200) * piece_bytes - port.unread_bytes, bytearray()
            while len(got) < due:
                got += autopilot.recv(1 << 20)
                port.write([])
        port.close()
    assert len(got) == due
    assert all(len(set(got[at : at + piece_bytes])) == 1 for at in range(0, due, piece_bytes))
    assert 200 * piece_bytes > MAX_WRITE_BYTES


class Client(Endpoint):
    """A ground station."""

    def __init__(self, *, can_wait: bool = True) -> None:
        super().__init__("client")
        self.can_wait = can_wait
        self.heard = b""

    async def open(self) -> None:
        self.connections += 1

    def write(self, data: bytes) -> None:
        self.heard += data

    async def close(self) -> None:
        pass

    def _hold(self) -> None:
        pass

    def _go_on(self) -> None:
        pass


async def test_stations_are_heard_no_faster_than_the_line_and_all_see_the_same() -> None:
    clients = Client(), Client(can_wait=False)
    port = GroundPort(clients, 57_600, 50 * MS)
    await port.open()
    clients[0].on_data(bytes(600), clients[0])
    assert [client.is_held for client in clients] == [True, False]
    assert len(port.read()) == 288  # 57600 baud carry 5760 bytes a second
    assert clients[0].is_held
    assert len(port.read()) == 288
    assert not clients[0].is_held
    assert port.read() == bytes(24)
    assert port.read() == b""
    clients[1].on_data(bytes(20_000), clients[1])
    clients[1].on_data(b"too fast", clients[1])
    assert port.overrun_bytes == 8
    port.write([b"ab", b"c"])
    assert [client.heard for client in clients] == [b"abc", b"abc"]


async def test_a_station_that_cannot_wait_does_not_keep_others_from_the_line() -> None:
    """One sends 8 kB a second by UDP; another, which is read when it may be, gets its half of 5760 B/s all the same."""
    waits, floods = Client(), Client(can_wait=False)
    port = GroundPort([floods, waits], 57_600, 50 * MS)
    await port.open()
    ours, theirs = heartbeat(sysid=1), heartbeat(sysid=2)
    heard = b""
    for _ in range(100):
        floods.on_data(theirs * (400 // len(theirs)), floods)
        while not waits.is_held:
            waits.on_data(ours, waits)
        heard += port.read()
    frames = [heard[at : at + len(ours)] for at in range(0, len(heard) - len(ours), len(ours))]
    assert set(frames) == {ours, theirs}, "frames of two stations are mixed up"
    assert frames.count(ours) * len(ours) > 0.49 * 5 * 5760


async def test_a_frame_in_two_parts_stays_whole_beside_another_station() -> None:
    alice, bob = Client(), Client()
    port = GroundPort([alice, bob], 57_600, 50 * MS)
    await port.open()
    ours, theirs = heartbeat(sysid=1), heartbeat(sysid=2)
    alice.on_data(ours + ours[:10], alice)
    bob.on_data(theirs, bob)
    assert port.read() == ours + theirs
    alice.on_data(ours[10:], alice)
    bob.on_data(b"no frame", bob)
    assert port.read() == ours + b"no frame"


async def test_the_parts_of_a_lone_station_are_heard_at_once() -> None:
    client = Client()
    port = GroundPort([client], 57_600, 50 * MS)
    await port.open()
    client.on_data(heartbeat()[:10], client)
    assert port.read() == heartbeat()[:10]


@pytest.mark.parametrize("baud", [57_600, 460_800])
async def test_a_line_is_kept_busy_by_a_station_that_waits(baud: int) -> None:
    """A pseudo-terminal is read 1 kB at a time: it fills a fast line, too."""
    client = Client()
    port = GroundPort([client], baud, 50 * MS)
    await port.open()
    heard = 0
    for _ in range(20):
        while not client.is_held:
            client.on_data(bytes(1024), client)
        heard += len(port.read())
    assert heard == pytest.approx(baud / 10, abs=20)
