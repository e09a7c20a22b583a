"""Zenoh sessions that speak our messages: one router per run, everything else a client of it.

Scouting and gossip are off: with them two clients could find each other and talk past the radio. The router of a run
asks for user and password, and lets each do what the table of rights says (`bridge.bus.identity`).
"""

from __future__ import annotations

import json
import re
import socket
import struct
import threading
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import zenoh
from zenoh.handlers import Callback

from bridge.bus.identity.guard import RouterGuard
from bridge.bus.identity.keyring import Credentials
from bridge.bus.keys import ROOT
from bridge.bus.messages import Message, encode, encoding_of
from bridge.timeouts import LEASE_S, LEAVE_S

CONNECT_RETRY = {"period_init_ms": 50, "period_max_ms": 50, "period_increase_factor": 1}
"""The processes of a run start together, so that most knock before the router is there (Zenoh: each second)."""
STUCK_READER_S = 1.0
"""How long the router waits for a reader that takes nothing before it cuts it off (Zenoh's default: 5 s)."""
FLUSH_KEY = f"{ROOT}/flush"
"""Which nobody serves, so that the router itself answers, after all that came before."""
_ATTACHMENT = struct.Struct("<qqB16s")
"""Sequence number, time in ns, length of the id, id: the layout that rmw_zenoh attaches to a sample."""

JSON = "application/json"
"""The encoding of what is no message of ours: logged values, answers of the clock."""
Sample = zenoh.Sample
Query = zenoh.Query
_UNSAID = str(zenoh.Encoding.ZENOH_BYTES)
"""The encoding that Zenoh gives to bytes of which their sender says nothing."""


class SessionError(RuntimeError):
    """The Zenoh session could not be opened."""


@dataclass(frozen=True, slots=True)
class Stamp:
    """What travels beside a packet: its number, and when it was sent (sim time).

    The source is what the sender says of itself. A packet's key names its sender, which the router guards.
    """

    seq: int
    sim_time_ns: int
    source: bytes = b""
    SIZE_BYTES: ClassVar[int] = _ATTACHMENT.size
    """Of the attachment; what was received has more behind it (`bridge.bus.reception`)."""

    def to_bytes(self) -> bytes:
        """The 33 bytes of the attachment."""
        return _ATTACHMENT.pack(self.seq, self.sim_time_ns, 16, self.source)

    @classmethod
    def from_sample(cls, sample: Sample | Query) -> Self | None:
        """The stamp of a sample (a query has a place for one, too), or None if it carries none."""
        if sample.attachment is None:
            return None
        raw = sample.attachment.to_bytes()
        if len(raw) < _ATTACHMENT.size:
            return None
        seq, sim_time_ns, id_length, source = _ATTACHMENT.unpack_from(raw)
        return cls(seq, sim_time_ns, source.rstrip(b"\0")) if id_length == 16 else None


def encoding_said(sample: Sample) -> str:
    """What a sample's payload is said to be; "" if its sender said nothing."""
    encoding = str(sample.encoding)
    return "" if encoding == _UNSAID else encoding


def answer(query: Query, key: str, payload: bytes, encoding: str) -> bool:
    """Reply to a query; returns False if whoever asked is gone."""
    try:
        query.reply(key, payload, encoding=encoding)
    except zenoh.ZError:
        return False
    return True


def refuse(query: Query, payload: bytes, encoding: str) -> bool:
    """Reply to a query with an error; returns False if whoever asked is gone."""
    try:
        query.reply_err(payload, encoding=encoding)
    except zenoh.ZError:
        return False
    return True


def end_of_answers(query: Query) -> None:
    """There will be no more replies."""
    with suppress(zenoh.ZError):
        query.drop()


def free_port(host: str = "127.0.0.1") -> int:
    """A TCP port that nobody listens on at this moment."""
    with socket.socket() as probe:
        probe.bind((host, 0))
        return int(probe.getsockname()[1])


def _config(settings: Iterable[tuple[str, Any]]) -> zenoh.Config:
    config = zenoh.Config()
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("scouting/gossip/enabled", "false")
    config.insert_json5("adminspace/enabled", "false")
    config.insert_json5(
        "transport/shared_memory/enabled", "false"
    )  # it leaves a file in /dev/shm per process
    config.insert_json5("transport/link/tx/lease", str(int(LEASE_S * 1000)))
    for key, value in settings:
        config.insert_json5(key, json.dumps(value))
    return config


class Session:
    """One Zenoh session. Use `open_router` or `open_client`; close it, or use it as a context manager.

    Args:
        inner: Zenoh's own.
        is_client: it reaches the others through a router.
    """

    def __init__(self, inner: zenoh.Session, *, is_client: bool) -> None:
        self._inner = inner
        self._is_client = is_client
        self._kept: list[Any] = []

    def put(self, key: str, message: Message, *, must_arrive: bool = False) -> None:
        """Publish one of our messages. ``must_arrive``: wait for a slow reader instead of dropping."""
        self.put_bytes(key, encode(message), encoding=encoding_of(type(message)), must_arrive=must_arrive)

    def put_bytes(
        self,
        key: str,
        payload: Any,
        *,
        encoding: str = "",
        attachment: Any = None,
        must_arrive: bool = False,
    ) -> None:
        """Publish bytes as they are; ``encoding`` says what they are."""
        control = zenoh.CongestionControl.BLOCK if must_arrive else zenoh.CongestionControl.DROP
        self._inner.put(
            key, payload, encoding=encoding or None, attachment=attachment, congestion_control=control
        )

    def subscribe(self, key_expr: str, callback: Callable[[Sample], object]) -> None:
        """Call ``callback`` for each sample, in Zenoh's own thread: it must only hand the sample on.

        Samples of one sender come in the order of its puts, over all subscriptions of this session.
        """
        self._kept.append(self._inner.declare_subscriber(key_expr, Callback(callback, indirect=False)))

    def interest(self, key_expr: str) -> Callable[[], bool]:
        """A question that costs a microsecond: whether anybody subscribes to what ``key_expr`` matches."""
        publisher = self._inner.declare_publisher(key_expr)
        self._kept.append(publisher)

        def is_wanted() -> bool:
            status: Any = publisher.matching_status
            return bool(status.matching)

        return is_wanted

    def serve(self, key: str, callback: Callable[[Query], object]) -> None:
        """Call ``callback`` for each query on ``key``, in Zenoh's own thread: it must only hand it on."""
        self._kept.append(self._inner.declare_queryable(key, Callback(callback, indirect=False)))

    def query(
        self,
        key: str,
        message: Message,
        on_reply: Callable[[zenoh.Reply], object],
        on_end: Callable[[], object],
        *,
        timeout_s: float,
    ) -> None:
        """Ask ``key``; ``on_reply`` gets each reply and ``on_end`` the end of them, in Zenoh's own thread."""
        self._inner.get(
            key,
            Callback(on_reply, on_end, indirect=False),
            payload=encode(message),
            encoding=encoding_of(type(message)),
            timeout=timeout_s,
            consolidation=zenoh.ConsolidationMode.NONE,
        )

    def query_bytes(
        self, key: str, payload: bytes, on_reply: Callable[[zenoh.Reply], object], *, timeout_s: float
    ) -> None:
        """Ask ``key`` with bytes as they are; ``on_reply`` gets each reply, in Zenoh's own thread."""
        handler = Callback(on_reply, indirect=False)
        self._inner.get(key, handler, payload=payload, timeout=timeout_s)

    def declare_alive(self, key: str) -> None:
        """Hold a liveliness token as long as this session is open."""
        self._kept.append(self._inner.liveliness().declare_token(key))

    def watch_alive(self, key_expr: str, callback: Callable[[str, bool], object]) -> None:
        """Call ``callback(key, is_alive)`` for each token that is there, comes or goes."""

        def on_token(sample: Sample) -> None:
            callback(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

        watcher = self._inner.liveliness().declare_subscriber(
            key_expr, Callback(on_token, indirect=False), history=True
        )
        self._kept.append(watcher)

    def close(self) -> None:
        """Undeclare everything and leave; what a client published is with its router then, if that still reads."""
        self._kept.clear()
        if self._inner.is_closed():
            return
        try:
            if self._is_client:
                self._flush()
        finally:  # a signal may end the wait
            self._inner.close()

    def _flush(self) -> None:
        """Zenoh loses what it has yet to send in some 7 of 1000 sessions that close: wait until that is sent."""
        arrived = threading.Event()
        nothing: Any = Callback(lambda _: None, arrived.set, indirect=False)
        with suppress(zenoh.ZError):  # nobody is there any more
            block = zenoh.CongestionControl.BLOCK
            self._inner.get(FLUSH_KEY, nothing, timeout=LEAVE_S, congestion_control=block)
            arrived.wait(LEAVE_S)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def open_router(endpoint: str, guard: RouterGuard | None = None) -> Session:
    """A session that routes for all the others.

    Args:
        endpoint: where it listens, such as ``tcp/127.0.0.1:7447``.
        guard: whom it lets in, and what they may do; None: everybody, everything (no run of ours does that).

    Raises:
        SessionError: if it cannot listen there.
    """
    settings = [
        ("mode", "router"),
        ("listen/endpoints", [endpoint]),
        ("listen/exit_on_failure", True),
        ("scouting/delay", 0),  # nobody is looked for, so nobody need be waited for
        ("transport/link/tx/queue/congestion_control/block/wait_before_close", int(STUCK_READER_S * 1e6)),
        *(guard.settings if guard is not None else ()),
    ]
    return _open(settings, lambda: f"cannot listen on {endpoint}", is_client=False)


def open_client(endpoint: str, credentials: Credentials | None = None, *, timeout_s: float = 0.0) -> Session:
    """A session that reaches the others through the router at ``endpoint`` only.

    Args:
        endpoint: where the router listens.
        credentials: as whom.
        timeout_s: how long to try (wall time); 0: once, as a router that refuses looks to Zenoh like one that is not
            there yet.

    Raises:
        SessionError: if there is no router, or it does not let this user in.
    """
    settings: list[tuple[str, Any]] = [
        ("mode", "client"),
        ("connect/endpoints", [endpoint]),
        ("connect/timeout_ms", int(timeout_s * 1000)),
        ("connect/exit_on_failure", True),
        ("connect/retry", CONNECT_RETRY),
    ]
    user = "nobody"
    if credentials is not None:
        user = credentials.user
        settings += [
            ("transport/auth/usrpwd/user", credentials.user),
            ("transport/auth/usrpwd/password", credentials.password),
        ]
    return _open(settings, lambda: _why_no_client(endpoint, user), is_client=True)


def is_listened_at(endpoint: str) -> bool:
    """Whether somebody takes connections at an endpoint, as ``tcp/127.0.0.1:7447``."""
    host, _, port = endpoint.partition("/")[2].rpartition(":")
    try:
        with socket.create_connection((host.strip("[]"), int(port)), timeout=1.0):
            return True
    except (OSError, ValueError):
        return False


def _why_no_client(endpoint: str, user: str) -> str:
    if is_listened_at(endpoint):
        return f"the Zenoh router at {endpoint} does not let {user} in"
    return f"no Zenoh router answers at {endpoint}"


def _open(settings: list[tuple[str, Any]], failure: Callable[[], str], *, is_client: bool) -> Session:
    try:
        return Session(zenoh.open(_config(settings)), is_client=is_client)
    except zenoh.ZError as error:
        raise SessionError(f"{failure()} ({plain_text(error)})") from error


def plain_text(error: zenoh.ZError) -> str:
    """What Zenoh says went wrong, without the places in its source."""
    return re.sub(r"\s+at /\S+?:\d+\.?", "", str(error)).strip()


def checked_endpoint(endpoint: str) -> str:
    """Return ``endpoint`` if it has the form of one, else raise ValueError."""
    if not re.fullmatch(r"(tcp|tls|udp|quic|ws)/[^/\s]+:\d{1,5}", endpoint):
        raise ValueError(f"{endpoint!r} is not a Zenoh endpoint, such as tcp/127.0.0.1:7447")
    return endpoint
