"""A witness that is as fast as the kernel: when a message came is the kernel's time stamp, not the reader's.

It reads two connections: one to the daemon, and one to the same autopilot without the daemon (or a relay of a few
lines between them). What both miss is the machine's doing, not the daemon's.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import select
import socket
import struct
import time
from collections.abc import Iterator, Sequence
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from aps.wire.framer import Framer
from benchmarks.aps.aps_sources import RATE_HZ, SYSID

_SO_TIMESTAMPING: Final = 37
"""Linux; Python has no name for it."""
_RX_SOFTWARE: Final = 1 << 3 | 1 << 4
_SYSTEM_TIME: Final = 2
_STAMP: Final = struct.Struct("qq")

Piece = tuple[int, bytes]
"""When it came, ns of the time of day, and what."""


def stamped(connection: socket.socket) -> None:
    """Have the kernel note when what comes has come."""
    connection.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPING, _RX_SOFTWARE)


def connect(port: int, timeout_s: float = 20.0) -> socket.socket:
    """A connection with the kernel's time stamps; tried again while nobody listens yet."""
    until_s = time.monotonic() + timeout_s
    while True:
        try:
            connection = socket.create_connection(("127.0.0.1", port))
        except ConnectionRefusedError:
            if time.monotonic() > until_s:
                raise
            time.sleep(0.1)
            continue
        stamped(connection)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return connection


def piece_of(connection: socket.socket) -> Piece:
    """What has come: of several segments at once the stamp is the last one's."""
    data, notes, _, _ = connection.recvmsg(1 << 16, 256)
    for level, kind, stamp in notes:
        if (level, kind) == (socket.SOL_SOCKET, _SO_TIMESTAMPING):
            seconds, ns = _STAMP.unpack_from(stamp)
            return seconds * 1_000_000_000 + ns, data
    return time.time_ns(), data


def ask_for(msg_id: int) -> bytes:
    """A ground station's request for a message at the rate that is watched."""
    mav = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
    message = mavlink.MAVLink_command_long_message(SYSID, 1, 511, 0, msg_id, 1e6 / RATE_HZ, 0, 0, 0, 0, 0)
    return bytes(message.pack(mav))


def witness(ports: Sequence[int], msg_id: int, seconds: float) -> None:
    """Receive, and say for each port how long it was without a message at most."""
    with contextlib.ExitStack() as stack:
        connections = [stack.enter_context(connect(port)) for port in ports]
        _until_steady(connections, msg_id)
        print("READY", flush=True)
        pieces = _read(connections, seconds)
    print(json.dumps([judged(got, msg_id) for got in pieces]), flush=True)


def _until_steady(connections: Sequence[socket.socket], msg_id: int) -> None:
    """Ask until the message comes at its rate on all connections."""
    for _ in range(30):
        if msg_id != _SYSTEM_TIME:
            for connection in connections:
                connection.sendall(ask_for(msg_id))
        counts = [judged(got, msg_id)["messages"] for got in _read(connections, 1.0)]
        if min(counts) > 0.8 * RATE_HZ:
            return
    raise RuntimeError(f"message {msg_id} does not come at {RATE_HZ} Hz: {counts}")


def _read(connections: Sequence[socket.socket], seconds: float) -> list[list[Piece]]:
    pieces: list[list[Piece]] = [[] for _ in connections]
    end_s = time.monotonic() + seconds
    while (left_s := end_s - time.monotonic()) > 0.0:
        ready, _, _ = select.select(connections, (), (), left_s)
        for connection in ready:
            pieces[connections.index(connection)].append(piece_of(connection))
    return pieces


def _arrivals(pieces: Sequence[Piece], msg_id: int) -> Iterator[tuple[int, bytes]]:
    framer = Framer()
    for at_ns, data in pieces:
        for frame in framer.receive(data):
            if (frame.sysid, frame.compid, frame.msg_id) == (SYSID, 1, msg_id):
                yield at_ns, frame.payload


def judged(pieces: Sequence[Piece], msg_id: int) -> dict[str, Any]:
    """Longest gap, how many messages came, and, of the clock's, the longest delay since they were sent."""
    came = list(_arrivals(pieces, msg_id))
    gaps_ns = [later - earlier for (earlier, _), (later, _) in itertools.pairwise(came)]
    told: dict[str, Any] = {"messages": len(came), "gap_ms": max(gaps_ns, default=0) / 1e6}
    if msg_id == _SYSTEM_TIME:
        delays_ns = [
            at - 1000 * int.from_bytes(payload.ljust(12, b"\0")[:8], "little") for at, payload in came
        ]
        told["delay_ms"] = max(delays_ns, default=0) / 1e6
    return told


def relay(port: int) -> None:
    """A relay that does not look: what a hop of its own costs on this machine, beside the daemon."""
    with socket.create_connection(("127.0.0.1", port)) as source:
        with socket.create_server(("127.0.0.1", 0)) as server:
            print(server.getsockname()[1], flush=True)
            out, _ = server.accept()
        out.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        while data := source.recv(1 << 16):
            out.sendall(data)
