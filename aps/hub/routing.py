"""Which links a MAVLink frame goes to: the rules in one place, a counter per outcome, no I/O and no clock.

The rules (those of ArduPilot's MAVLink_routing, see "Routing" in mavlink.io's guide):

- a frame never goes back to the link it came from;
- no target, or target system 0: every other link;
- target system of another UA or ground station: only links that have seen that system;
- our own UA's system with a component: only links that have seen that component (component 0: all that have
  seen the system);
- HEARTBEAT: every other link but those already known to reach its sender (this is what ends loops);
- RADIO and RADIO_STATUS describe one link and are never forwarded;
- what claims to come from ourselves, or from the autopilot on any link but the autopilot's, is a loop or a
  forgery and goes nowhere.

ArduPilot sends untargeted frames of others only to links with a learned route. Here every link counts as
having one from the start, since many clients only listen (a dashboard, a pymavlink script): they would
otherwise see no telemetry at all.

Routes are learned from the sender of each frame and expire when it is silent; a closed link's go at once.
"""

from __future__ import annotations

from collections import Counter
from enum import Enum
from typing import Final, NamedTuple

from aps.timeouts import ROUTE_EXPIRY_S
from aps.wire.framer import Frame

__all__ = ["Outcome", "Route", "Router"]

NS_PER_S: Final = 1_000_000_000
DEFAULT_ROUTE_EXPIRY_NS: Final = round(ROUTE_EXPIRY_S * NS_PER_S)
MAX_LEARNED: Final = 1024
"""Bound on remembered (system, component) pairs: a peer that sends from random ids cannot fill the memory."""

_HEARTBEAT: Final = 0
_LINK_LOCAL: Final = frozenset({109, 166})
"""RADIO_STATUS and RADIO: about the link they arrive on."""


class Outcome(Enum):
    """What the rules made of a frame. Every frame has exactly one."""

    BROADCAST = "broadcast"
    HEARTBEAT = "heartbeat"
    TARGETED = "targeted"
    LOCAL = "local"
    """For ourselves alone."""
    LINK_LOCAL = "link_local"
    NO_ROUTE = "no_route"
    """No other link has seen the target."""
    LOOP = "loop"


class Route(NamedTuple):
    """Decision for one frame."""

    outcome: Outcome
    links: tuple[int, ...]
    """Ids of the links to send the original bytes to."""
    to_us: bool
    """Whether the daemon itself is (also) addressed."""


_LINK_LOCAL_ROUTE: Final = Route(Outcome.LINK_LOCAL, (), True)
_LOOP_ROUTE: Final = Route(Outcome.LOOP, (), False)
_LOCAL_ROUTE: Final = Route(Outcome.LOCAL, (), True)


class Router:
    """Routing table of one daemon.

    Args:
        sysid: system id of the UA, shared by its autopilot and by us.
        compid: our own component id.
        autopilot_compid: the autopilot's component id.
        route_expiry_ns: a learned route is forgotten after this silence, in the clock of ``now_ns``.
    """

    def __init__(
        self,
        sysid: int,
        compid: int,
        autopilot_compid: int = 1,
        route_expiry_ns: int = DEFAULT_ROUTE_EXPIRY_NS,
    ) -> None:
        if route_expiry_ns <= 0:
            raise ValueError(f"route_expiry_ns must be positive, not {route_expiry_ns}")
        self.sysid = sysid
        self.compid = compid
        self.autopilot_compid = autopilot_compid
        self.route_expiry_ns = route_expiry_ns
        self.counters: Counter[Outcome] = Counter()
        self._autopilot_link: int | None = None
        self._others: dict[int, tuple[int, ...]] = {}
        self._seen: dict[int, dict[int, int]] = {}
        """sysid << 8 | compid -> link -> instant of the latest frame, ns."""

    @property
    def links(self) -> tuple[int, ...]:
        """Ids of the open links."""
        return tuple(self._others)

    def add_link(self, link: int, *, autopilot: bool = False) -> None:
        """Open a link. The autopilot's is known to reach the UA's system before it has spoken."""
        if link in self._others:
            raise ValueError(f"link {link} is already open")
        if autopilot:
            self._autopilot_link = link
        self._rebuild([*self._others, link])

    def remove_link(self, link: int) -> None:
        """Close a link and forget what was learned on it."""
        if link == self._autopilot_link:
            self._autopilot_link = None
        for key in [
            key for key, links in self._seen.items() if links.pop(link, None) is not None and not links
        ]:
            del self._seen[key]
        self._rebuild([other for other in self._others if other != link])

    def expire(self, now_ns: int) -> None:
        """Drop routes whose sender has been silent (they are ignored from their expiry on in any case)."""
        oldest_ns = now_ns - self.route_expiry_ns
        for key, links in list(self._seen.items()):
            for link in [link for link, seen_ns in links.items() if seen_ns < oldest_ns]:
                del links[link]
            if not links:
                del self._seen[key]

    def knows(self, link: int, sysid: int, compid: int, now_ns: int) -> bool:
        """Whether a link is known to reach a component."""
        if link == self._autopilot_link and sysid == self.sysid and compid == self.autopilot_compid:
            return True
        seen_ns = self._seen.get(sysid << 8 | compid, {}).get(link)
        return seen_ns is not None and now_ns - seen_ns <= self.route_expiry_ns

    def route(self, frame: Frame, source: int, now_ns: int) -> Route:
        """Decide one frame that came in on ``source`` and learn its sender."""
        sysid = frame.sysid
        if sysid == self.sysid and self._is_loop(frame.compid, source):
            route = _LOOP_ROUTE
        else:
            if sysid:
                self._learn(sysid << 8 | frame.compid, source, now_ns)
            if frame.msg_id == _HEARTBEAT:
                route = self._heartbeat(frame, source, now_ns)
            elif frame.msg_id in _LINK_LOCAL:
                route = _LINK_LOCAL_ROUTE
            elif frame.target_system == 0:
                route = Route(Outcome.BROADCAST, self._others.get(source, ()), True)
            else:
                route = self._targeted(frame, source, now_ns)
        self.counters[route.outcome] += 1
        return route

    def _is_loop(self, compid: int, source: int) -> bool:
        if compid == self.autopilot_compid:
            return source != self._autopilot_link
        return compid == self.compid

    def _learn(self, key: int, source: int, now_ns: int) -> None:
        links = self._seen.get(key)
        if links is None:
            if len(self._seen) >= MAX_LEARNED:
                self._forget_oldest()
            links = self._seen[key] = {}
        links[source] = now_ns

    def _forget_oldest(self) -> None:
        del self._seen[min(self._seen, key=lambda key: max(self._seen[key].values()))]

    def _heartbeat(self, frame: Frame, source: int, now_ns: int) -> Route:
        links = tuple(
            link
            for link in self._others.get(source, ())
            if not self.knows(link, frame.sysid, frame.compid, now_ns)
        )
        return Route(Outcome.HEARTBEAT, links, True)

    def _targeted(self, frame: Frame, source: int, now_ns: int) -> Route:
        system, component = frame.target_system, frame.target_component
        ours = system == self.sysid
        if ours and component == self.compid:
            return _LOCAL_ROUTE
        if ours and component:
            links = tuple(
                link for link in self._others.get(source, ()) if self.knows(link, system, component, now_ns)
            )
        else:
            links = self._reaching_system(system, source, now_ns)
        to_us = ours and component == 0
        return Route(Outcome.TARGETED if links else Outcome.NO_ROUTE, links, to_us)

    def _reaching_system(self, system: int, source: int, now_ns: int) -> tuple[int, ...]:
        oldest_ns = now_ns - self.route_expiry_ns
        reached = {
            link
            for key, links in self._seen.items()
            if key >> 8 == system
            for link, seen_ns in links.items()
            if seen_ns >= oldest_ns
        }
        if system == self.sysid and self._autopilot_link is not None:
            reached.add(self._autopilot_link)
        return tuple(link for link in self._others.get(source, ()) if link in reached)

    def _rebuild(self, links: list[int]) -> None:
        self._others = {link: tuple(other for other in links if other != link) for link in links}
