"""The hub: every frame comes in here, whatever its link, and goes out to where the rules say. No I/O and no clock.

It does without a vehicle, too: a ground station's hub has only clients. Links come and go at run time.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Protocol

from aps.hub.routing import Outcome, Router
from aps.links.link import Link, Role
from aps.links.rules import RateLimiter
from aps.wire.framer import Frame

__all__ = ["Hub", "HubCounters", "Local", "Tap"]

Tap = Callable[[bytes, Link], None]
"""Told of each frame, its bytes: one that has come, as its link's rules allow, and one of our own that is sent."""


class Local(Protocol):
    """What is at home at the hub: the vehicle's side of the daemon."""

    def from_autopilot(self, frame: Frame, link: Link, now_ns: int) -> bool:
        """A frame came from an autopilot's link; returns whether it concerns others, too."""

    def addressed(self, frame: Frame, link: Link, alone: bool) -> None:
        """A frame came that is for us, or for everybody; ``alone``: nobody else has our ids."""

    def to_autopilot(self, frame: Frame, link: Link) -> bytes | None:
        """A client's frame is about to go to the autopilot: the bytes to send in its place, or ``None``."""


@dataclass(slots=True)
class HubCounters:
    """What the routing rules do not count."""

    dropped_no_autopilot: int = 0
    """Frames of our own for an autopilot that no link leads to."""
    kept: int = 0
    """Frames of the autopilot that answer us alone, though they name no target."""
    sent: int = 0
    """Frames of our own."""


class Hub:
    """Links and what goes between them.

    Args:
        router: decides.
        local: what is at home here; ``None``: nothing, frames are forwarded only.
    """

    def __init__(self, router: Router, local: Local | None = None) -> None:
        self.router = router
        self.local = local
        self.links: dict[int, Link] = {}
        self.taps: list[Tap] = []
        self.counters = HubCounters()
        self._limiters: dict[int, RateLimiter] = {}

    @property
    def primary(self) -> Link | None:
        """The link to the autopilot that is used."""
        number = self.router.primary
        return None if number is None else self.links[number]

    def add(self, link: Link) -> None:
        """A link is there.

        Raises:
            ValueError: one with its id is there already.
        """
        self.router.add_link(link.id, autopilot=link.role is Role.AUTOPILOT)
        self.links[link.id] = link
        if link.rules.max_rate_hz:
            self._limiters[link.id] = RateLimiter(link.rules.max_rate_hz)

    def remove(self, link_id: int) -> None:
        """A link is gone."""
        self.router.remove_link(link_id)
        del self.links[link_id]
        self._limiters.pop(link_id, None)

    def receive(self, frames: Sequence[Frame], link: Link, now_ns: int) -> None:
        """Frames from a link (what its rules let in, see ``Link.receive``), in order."""
        from_autopilot = link.role is Role.AUTOPILOT
        for frame in frames:
            for tap in self.taps:
                tap(frame.raw, link)
            self._take(frame, link, from_autopilot, now_ns)

    def _take(self, frame: Frame, link: Link, from_autopilot: bool, now_ns: int) -> None:
        local = self.local
        if from_autopilot and local is not None and not local.from_autopilot(frame, link, now_ns):
            self.counters.kept += 1
            return
        route = self.router.route(frame, link.id, now_ns)
        if route.to_us and local is not None:
            local.addressed(frame, link, route.outcome is not Outcome.TARGETED)
        for number in route.links:
            to = self.links[number]
            if to.role is Role.CLIENT or local is None:
                self._put(frame, frame.raw, to, now_ns)
                continue
            raw = local.to_autopilot(frame, link)
            if raw is not None:
                self._put(frame, raw, to, now_ns)

    def _put(self, frame: Frame, raw: bytes, to: Link, now_ns: int) -> None:
        if to.rules.outgoing is not None and not to.rules.gives(frame):
            to.counters.dropped_out += 1
            return
        limiter = self._limiters.get(to.id)
        if limiter is not None and not limiter.passes(frame, now_ns):
            to.counters.dropped_rate_out += 1
            return
        to.send(raw)

    def send(self, raw: bytes, link: Link) -> None:
        """Send a frame of our own."""
        self.counters.sent += 1
        self.router.sent(raw)
        for tap in self.taps:
            tap(raw, link)
        link.send(raw)

    def send_to_autopilot(self, raw: bytes) -> None:
        """Send a frame of our own to the autopilot; without a link to one it is dropped and counted."""
        primary = self.primary
        if primary is None:
            self.counters.dropped_no_autopilot += 1
        else:
            self.send(raw, primary)

    def statistics(self) -> dict[str, Any]:
        """Counters, as plain data."""
        return {
            "routes": {outcome.value: count for outcome, count in self.router.counters.items()},
            "hub": asdict(self.counters),
        }
