"""The hub: every frame comes in here, whatever its link, and goes out to where the rules say. No I/O and no clock.

It does without a vehicle, too: a ground station's hub has only clients. Links come and go at run time.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final, NamedTuple, Protocol

from aps.hub.routing import Router, RoutingOutcome
from aps.links.link import Link, Role
from aps.links.rules import RateLimiter
from aps.wire.framer import Frame

Tap = Callable[[bytes, Link], None]
"""Called with each frame, its bytes: one that has come, as its link's rules allow, and one of our own that is sent."""


class Local(Protocol):
    """What is at home at the hub: the vehicle's side of the daemon."""

    answered: frozenset[int]
    """Ids of the messages that it may answer: only those are passed on as addressed to it."""

    def from_autopilot(self, frame: Frame, link: Link, now_ns: int) -> bool:
        """A frame came from an autopilot's link; returns whether it concerns others, too."""

    def addressed(self, frame: Frame, link: Link, alone: bool) -> None:
        """A frame to be answered came that is for us, or for everybody; ``alone``: nobody else has our ids."""

    def to_autopilot(self, frame: Frame, link: Link) -> bytes | None:
        """A client's frame is about to go to the autopilot: the bytes to send in its place, or ``None``."""


MAX_WAYS: Final = 256
"""Bound on remembered sets of links that frames go to together."""


class _Way(NamedTuple):
    """Links that a frame goes to."""

    plain: tuple[Link, ...]
    """Get the bytes as they are."""
    guarded: tuple[Link, ...]
    """Have rules, or a key, or the autopilot behind them."""


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
        self._ways: dict[tuple[int, ...], _Way] = {}

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
        self._ways.clear()
        if link.rules.max_rate_hz:
            self._limiters[link.id] = RateLimiter(link.rules.max_rate_hz)

    def remove(self, link_id: int) -> None:
        """A link is gone."""
        self.router.remove_link(link_id)
        del self.links[link_id]
        self._ways.clear()
        self._limiters.pop(link_id, None)

    def receive(self, frames: Sequence[Frame], link: Link, now_ns: int) -> None:
        """Frames from a link (what its rules let in, see ``Link.receive``), in order."""
        local, router, ways, taps = self.local, self.router, self._ways, self.taps
        number, from_autopilot = link.id, link.role is Role.AUTOPILOT and local is not None
        plain: tuple[Link, ...] = ()
        together: list[bytes] = []  # frames for the same plain links, one after the other, are queued at once
        for frame in frames:
            raw = frame[0]
            for tap in taps:
                tap(raw, link)
            if from_autopilot and local is not None and not local.from_autopilot(frame, link, now_ns):
                self.counters.kept += 1
                continue
            outcome, links, to_us = router.route(frame, number, now_ns)
            if to_us and local is not None and frame[1] in local.answered:
                local.addressed(frame, link, outcome is not RoutingOutcome.TARGETED)
            way = ways.get(links) or self._way(links)
            if way.plain is not plain:
                _queue(together, plain)
                plain, together = way.plain, []
            together.append(raw)
            for to in way.guarded:
                self._guarded(frame, link, to, now_ns)
        _queue(together, plain)

    def _way(self, numbers: tuple[int, ...]) -> _Way:
        links = [self.links[number] for number in numbers]
        plain = tuple(link for link in links if self._is_plain(link))
        way = _Way(plain, tuple(link for link in links if link not in plain))
        if len(self._ways) >= MAX_WAYS:
            self._ways.clear()
        self._ways[numbers] = way
        return way

    def _is_plain(self, link: Link) -> bool:
        mine = link.role is Role.CLIENT or self.local is None
        free = link.rules.outgoing is None and link.signing is None and link.id not in self._limiters
        return mine and free

    def _guarded(self, frame: Frame, link: Link, to: Link, now_ns: int) -> None:
        if to.role is Role.CLIENT or self.local is None:
            self._put(frame, frame.raw, to, now_ns)
            return
        raw = self.local.to_autopilot(frame, link)
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


def _queue(frames: list[bytes], links: tuple[Link, ...]) -> None:
    if frames and links:
        size_bytes = sum(map(len, frames))
        for link in links:
            link.outbox.put_all(frames, size_bytes)
