"""The shell: owns the UDP socket to the physics and the TCP server for the client, and moves bytes.

As ArduPilot's SERIAL0, the server has one client: a second one connects (the kernel completes it) and gets
nothing until the first is gone; then it is served. A client that does not read is let wait for a moment (the
simulation waits with it, as ArduPilot's does); one that stays deaf loses telemetry, and after ``DEAF_MAX_S``
its connection.
"""

from __future__ import annotations

import selectors
import signal
import socket
import time
from collections import Counter
from types import FrameType

from bridge.standin.autopilot import Autopilot
from bridge.standin.wire.fdm_link import RESEND_AFTER_S

DATAGRAM_MAX_BYTES = 65536
READ_BYTES = 65536
UNSENT_WAIT_BYTES = 256 * 1024
"""More unsent bytes than this hold the simulation back."""
UNSENT_WAIT_MAX_S = 0.25
DEAF_MAX_S = 10.0
BACKLOG = 5


class PortInUseError(OSError):
    """A port that the autopilot needs cannot be bound."""


class Process:
    """One autopilot on real sockets. ``run`` returns after ``stop`` or a signal."""

    def __init__(
        self, autopilot: Autopilot, fdm_address: tuple[str, int], mavlink_address: tuple[str, int]
    ) -> None:
        """Bind the sockets.

        Args:
            autopilot: the core.
            fdm_address: host and UDP port of the physics.
            mavlink_address: host and TCP port to listen on; port 0 takes any free one.

        Raises:
            PortInUseError: the TCP port cannot be bound.
            OSError: the physics' host does not resolve.
        """
        self._autopilot = autopilot
        self._stopped = False
        self.errors: Counter[str] = Counter()
        """Socket errors survived, by kind."""
        self._listener = _listen(mavlink_address)
        self._udp = _connect_udp(fdm_address)
        self._wake_in, self._wake_out = socket.socketpair()
        self._wake_in.setblocking(False)
        self._wake_out.setblocking(False)
        self._client: socket.socket | None = None
        self._unsent = bytearray()
        self._drained_at_s = 0.0
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._udp, selectors.EVENT_READ)
        self._selector.register(self._listener, selectors.EVENT_READ)
        self._selector.register(self._wake_in, selectors.EVENT_READ)

    @property
    def mavlink_port(self) -> int:
        """The TCP port listened on."""
        return int(self._listener.getsockname()[1])

    def stop(self) -> None:
        """End ``run``; callable from a signal handler or another thread."""
        self._stopped = True
        try:
            self._wake_out.send(b"\0")
        except OSError:
            self.errors["wake"] += 1

    def stop_on_signals(self) -> None:
        """End ``run`` on SIGTERM and SIGINT."""

        def handler(_number: int, _frame: FrameType | None) -> None:
            self.stop()

        signal.signal(signal.SIGTERM, handler)
        signal.signal(signal.SIGINT, handler)

    def run(self) -> None:
        """Serve until stopped."""
        fdm = self._autopilot.fdm
        select, udp = self._selector.select, self._udp
        self._send_datagram(fdm.start(time.monotonic()))
        timeout_s = RESEND_AFTER_S
        while not self._stopped:
            ready = select(timeout_s)
            if len(ready) == 1 and ready[0][0].fileobj is udp:
                self._serve_physics()  # by far the most frequent case
                timeout_s = RESEND_AFTER_S
                continue
            self._serve({key.fileobj for key, _ in ready})
            now_s = time.monotonic()
            if now_s >= fdm.deadline_s():
                self._send_datagram(fdm.resend(now_s))
            timeout_s = max(0.0, fdm.deadline_s() - now_s)

    def _serve(self, ready: set[object]) -> None:
        """Serve what is ready; the client first, so that what it asked for holds from the next frame on."""
        if self._client is not None and self._client in ready:
            self._serve_client()
        if self._listener in ready:
            self._accept()
        if self._udp in ready:
            self._serve_physics()

    def close(self) -> None:
        """Close the sockets."""
        self._selector.close()
        for one in (self._udp, self._listener, self._wake_in, self._wake_out, self._client):
            if one is not None:
                one.close()

    # --- physics

    def _serve_physics(self) -> None:
        try:
            datagram = self._udp.recv(DATAGRAM_MAX_BYTES)
        except OSError:  # nobody listens there (yet): the silence rule sends again
            self.errors["physics_unreachable"] += 1
            return
        packet = self._autopilot.receive_sensors(datagram, time.monotonic())
        if self._autopilot.mavlink.has_data:
            self._flush()
            self._hold_back()
        if packet is not None:
            self._send_datagram(packet)

    def _send_datagram(self, packet: bytes) -> None:
        try:
            self._udp.send(packet)
        except OSError:
            self.errors["physics_unreachable"] += 1

    # --- client

    def _accept(self) -> None:
        try:
            client, _ = self._listener.accept()
        except OSError:  # gone before it was accepted
            self.errors["accept"] += 1
            return
        client.setblocking(False)
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        client.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        self._client = client
        self._unsent.clear()
        self._drained_at_s = time.monotonic()
        self._autopilot.mavlink.connect()
        self._selector.unregister(self._listener)  # one client at a time
        self._selector.register(client, selectors.EVENT_READ)

    def _serve_client(self) -> None:
        client = self._client
        if client is None:
            return
        try:
            data = client.recv(READ_BYTES)
        except BlockingIOError:  # ready to write, not to read
            self._flush()
            return
        except OSError:
            self.errors["client_lost"] += 1
            data = b""
        if not data:
            self._release_client()
            return
        self._autopilot.mavlink.receive(data)
        self._flush()

    def _release_client(self) -> None:
        if self._client is None:
            return
        self._selector.unregister(self._client)
        self._client.close()
        self._client = None
        self._unsent.clear()
        self._autopilot.mavlink.disconnect()
        self._selector.register(self._listener, selectors.EVENT_READ)

    def _flush(self) -> None:
        """Send what waits; keep what the socket does not take."""
        client = self._client
        data = self._autopilot.mavlink.data_to_send()
        if client is None:
            return
        if not self._unsent:
            self._drained_at_s = time.monotonic()
        if len(self._unsent) <= UNSENT_WAIT_BYTES:
            self._unsent += data
        else:
            self.errors["telemetry_dropped_bytes"] += len(data)
        if not self._unsent:
            return
        try:
            sent = client.send(self._unsent)
        except BlockingIOError:
            sent = 0
        except OSError:
            self.errors["client_lost"] += 1
            self._release_client()
            return
        self._note_sent(client, sent)

    def _note_sent(self, client: socket.socket, sent: int) -> None:
        now_s = time.monotonic()
        if sent:
            del self._unsent[:sent]
            self._drained_at_s = now_s
        elif now_s - self._drained_at_s > DEAF_MAX_S:
            self.errors["client_deaf"] += 1
            self._release_client()
            return
        interest = selectors.EVENT_READ | (selectors.EVENT_WRITE if self._unsent else 0)
        if self._selector.get_key(client).events != interest:
            self._selector.modify(client, interest)

    def _hold_back(self) -> None:
        """Let the simulation wait a moment for a client that is behind."""
        until_s = time.monotonic() + UNSENT_WAIT_MAX_S
        if time.monotonic() - self._drained_at_s > UNSENT_WAIT_MAX_S:
            return  # deaf already: it does not hold the others up
        while (
            self._client is not None and len(self._unsent) > UNSENT_WAIT_BYTES and time.monotonic() < until_s
        ):
            with selectors.DefaultSelector() as writable:
                writable.register(self._client, selectors.EVENT_WRITE)
                writable.select(UNSENT_WAIT_MAX_S)
            self._flush()


def _listen(address: tuple[str, int]) -> socket.socket:
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind(address)
        listener.listen(BACKLOG)
    except OSError as error:
        listener.close()
        raise PortInUseError(
            f"cannot listen on TCP {address[0]}:{address[1]} ({error.strerror or error}); "
            "choose another with --mavlink-port"
        ) from error
    listener.setblocking(False)
    return listener


def _connect_udp(address: tuple[str, int]) -> socket.socket:
    udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        udp.connect(address)
    except OSError as error:
        udp.close()
        raise OSError(
            f"cannot reach the physics at UDP {address[0]}:{address[1]} ({error.strerror or error}); "
            "see --fdm-host and --fdm-port"
        ) from error
    udp.setblocking(False)
    return udp
