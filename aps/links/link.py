"""A link: one way to a peer. What is behind it (TCP, UDP, a serial line, a test) makes no difference to the hub."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from enum import Enum
from typing import Any, Final, Protocol

from aps.links.latency import LinkLatency
from aps.links.outbox import FrameQueue
from aps.links.rules import NO_RULES, LinkRules
from aps.links.traffic import Traffic
from aps.wire.framer import Frame, Framer
from aps.wire.signing import Signing


class Role(Enum):
    """What is at the other end."""

    AUTOPILOT = "autopilot"
    """The vehicle's autopilot: commands go there, its word on the vehicle counts."""
    CLIENT = "client"
    """Whoever wants to see and steer the vehicle: ground stations, programs, other components."""


@dataclass(slots=True)
class LinkCounters:
    """What a link's peer was not given, or had to wait for."""

    throttled: int = 0
    """How often it was left waiting because it sent more than its allowance."""
    dropped_rate: int = 0
    """Datagrams beyond the allowance: nobody can be made to wait there."""
    dropped_in: int = 0
    """Frames that the link's rules keep from coming in."""
    dropped_out: int = 0
    """Frames that they keep from going out."""
    dropped_rate_out: int = 0
    """Frames that came faster than the link's own rates allow."""


@dataclass(frozen=True, slots=True)
class Opening:
    """How links of one place are made."""

    role: Role = Role.CLIENT
    rules: LinkRules = field(default=NO_RULES)


CLIENT_OPENING: Final = Opening()


class Link:
    """One way to a peer.

    Args:
        name: the peer, for people.
        outbox: what waits to be sent.
        opening: its role and rules.
        connectionless: whether only silence shows that the peer is gone (UDP, serial).
    """

    def __init__(
        self,
        name: str,
        outbox: FrameQueue,
        opening: Opening = Opening(),
        *,
        connectionless: bool = False,
    ) -> None:
        self.id: int = UNNUMBERED
        """Set by the owner when the link opens; no number means anything."""
        self.name = name
        self.role = opening.role
        self.rules = opening.rules
        self.outbox = outbox
        self.connectionless = connectionless
        self.framer = Framer()
        self.traffic = Traffic()
        self.latency = LinkLatency() if opening.role is Role.AUTOPILOT else None
        """Round trips to the autopilot, where one is."""
        self.counters = LinkCounters()
        key = opening.rules.key
        self.signing = None if key is None else Signing(key, lambda: time.time_ns() // 1000)
        """Signs and verifies, if the link has a key."""
        self._holds: set[str] = set()

    def hold(self, reason: str) -> None:
        """Leave further bytes where they are, so that the peer has to wait, until ``release``."""
        if not self._holds:
            self._pause_reading()
        self._holds.add(reason)

    def release(self, reason: str) -> None:
        """End one reason for not reading."""
        if reason in self._holds:
            self._holds.discard(reason)
            if not self._holds:
                self._resume_reading()

    def receive(self, data: bytes, now_ns: int) -> list[Frame]:
        """Bytes came: the frames that they complete and that the link's rules let in, in order."""
        frames = self.framer.receive(data)
        self.traffic.received(frames, len(data), now_ns)
        if self.signing is not None:
            frames = [frame for frame in frames if self.signing.verify(frame)]
        if self.rules.incoming is None and not self.rules.read_only:
            return frames
        taken = [frame for frame in frames if self.rules.takes(frame)]
        self.counters.dropped_in += len(frames) - len(taken)
        return taken

    def send(self, raw: bytes) -> None:
        """Queue one frame, signed if the link has a key."""
        if self.signing is None:
            self.outbox.put(raw)
        elif (signed := self.signing.sign(raw)) is not None:
            self.outbox.put(signed)

    @property
    def can_wait(self) -> bool:
        """Whether a peer that is not read has to wait (else what it sends is lost)."""
        return True

    def abort(self) -> None:
        """Close at once, without waiting for the peer to read."""

    def _pause_reading(self) -> None:
        """Stop reading."""

    def _resume_reading(self) -> None:
        """Read again."""

    def statistics(self, now_ns: int) -> Mapping[str, Any]:
        """Counters, as plain data."""
        return {
            "link": self.id,
            "peer": self.name,
            "role": self.role.value,
            **self.traffic.statistics(now_ns),
            **({} if self.latency is None else {"latency": self.latency.statistics()}),
            "framer": asdict(self.framer.counters),
            "outbox": asdict(self.outbox.counters),
            **asdict(self.counters),
            **({} if self.signing is None else {"signing": asdict(self.signing.counters)}),
        }


UNNUMBERED: Final = 0


class LinkOwner(Protocol):
    """Gets what happens on links; all calls come in the event loop."""

    def link_opened(self, link: Link) -> bool:
        """There is a peer; False turns it away: the link is closed, and nothing more is reported of it."""

    def link_data(self, link: Link, data: bytes) -> None:
        """Bytes came, in any chunking."""

    def link_closed(self, link: Link, error: Exception | None) -> None:
        """The peer is gone."""
