"""Which links a MAVLink frame goes to: the rules in one place, a counter per outcome, no I/O and no clock.

The rules (those of ArduPilot's MAVLink_routing, see "Routing" in mavlink.io's guide):

- a frame never goes back to the link it came from;
- no target, or target system 0: every other link;
- target system of another UA or ground station: only links that have seen that system;
- our own UA's system with a component: only links that have seen that component (component 0: all that have
  seen the system). A component that nobody has seen: the autopilot, which decides;
- HEARTBEAT: every other link but those already known to reach its sender (this is what ends loops);
- RADIO and RADIO_STATUS describe one link and are never forwarded; SETUP_SIGNING has a key, and goes to its target
  only;
- what we have sent ourselves and comes back, and what claims to come from the autopilot on any link but the
  autopilot's, is a loop or a forgery and goes nowhere. Another component that shares our ids is heard: MAVROS
  and other programs on board are component 191, too.

ArduPilot sends untargeted frames of others only to links with a learned route. Here every link counts as
having one from the start, since many clients only listen (a dashboard, a pymavlink script): they would
otherwise see no telemetry at all.

One vehicle may have several autopilot links. One of them is the primary: what is for the autopilot goes there
alone, and only from there its untargeted messages are forwarded, and those of whoever else is heard there, so that
nobody gets anything twice.

Routes are learned from the sender of each frame and expire when it is silent; a closed link's go at once.
"""

from __future__ import annotations

from collections import Counter, deque
from enum import Enum
from typing import Final, NamedTuple

from aps.timeouts import ROUTE_EXPIRY_S
from aps.wire.framer import Frame

NS_PER_S: Final = 1_000_000_000
DEFAULT_ROUTE_EXPIRY_NS: Final = round(ROUTE_EXPIRY_S * NS_PER_S)
MAX_LEARNED: Final = 1024
"""Bound on remembered (system, component) pairs: a peer that sends from random ids cannot fill the memory."""
MAX_OWN: Final = 256
"""Frames of our own that are remembered, to know them when they come back."""

_HEARTBEAT: Final = 0
_SETUP_SIGNING: Final = 256
_LINK_LOCAL: Final = frozenset({109, 166})
"""RADIO_STATUS and RADIO: about the link they arrive on."""


class RoutingOutcome(Enum):
    """What the rules made of a frame. Every frame has exactly one."""

    __hash__ = object.__hash__  # an Enum's own is a Python function, called for every frame that is counted

    BROADCAST = "broadcast"
    HEARTBEAT = "heartbeat"
    TARGETED = "targeted"
    LOCAL = "local"
    """For ourselves alone."""
    LINK_LOCAL = "link_local"
    NO_ROUTE = "no_route"
    """No other link has seen the target."""
    LOOP = "loop"
    STANDBY = "standby"
    """By an autopilot's link that is not the primary one, from what is heard on that, too."""


class Route(NamedTuple):
    """Decision for one frame."""

    outcome: RoutingOutcome
    links: tuple[int, ...]
    """Ids of the links to send the original bytes to."""
    to_us: bool
    """Whether the daemon itself is (also) addressed."""


_LINK_LOCAL_ROUTE: Final = Route(RoutingOutcome.LINK_LOCAL, (), True)
_LOOP_ROUTE: Final = Route(RoutingOutcome.LOOP, (), False)
_STANDBY_ROUTE: Final = Route(RoutingOutcome.STANDBY, (), True)
_NOBODY_ROUTE: Final = Route(RoutingOutcome.BROADCAST, (), True)


class Router:
    """Routing table of one daemon.

    Args:
        sysid: system id of the UA, shared by its autopilot and by us; ``None``: there is no UA here (a ground
            station's hub).
        compid: our own component id.
        autopilot_compid: the autopilot's component id.
        route_expiry_ns: a learned route is forgotten after this silence, in the clock of ``now_ns``.
    """

    def __init__(
        self,
        sysid: int | None,
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
        self.counters: Counter[RoutingOutcome] = Counter()
        self._links: dict[int, None] = {}
        self._autopilots: set[int] = set()
        self._primary: int | None = None
        self._others: dict[int, Route] = {}
        """Link -> the way of its untargeted frames, of those that have sent some since links last changed."""
        self._seen: dict[int, dict[int, int]] = {}
        """sysid << 8 | compid -> link -> instant of the latest frame, ns."""
        self._own: deque[bytes] = deque(maxlen=MAX_OWN)
        self._own_set: Counter[bytes] = Counter()

    @property
    def links(self) -> tuple[int, ...]:
        """Ids of the open links."""
        return tuple(self._links)

    @property
    def primary(self) -> int | None:
        """The autopilot's link that is used; ``None`` when there is none."""
        return self._primary

    def add_link(self, link: int, *, autopilot: bool = False) -> None:
        """Open a link. The autopilot's is known to reach the UA's system before it has spoken."""
        if link in self._links:
            raise ValueError(f"link {link} is already open")
        self._links[link] = None
        if autopilot:
            self._autopilots.add(link)
            self._primary = link if self._primary is None else self._primary
        self._others.clear()

    def use(self, link: int) -> None:
        """Make one of the autopilot's links the primary one.

        Raises:
            ValueError: it is none.
        """
        if link not in self._autopilots:
            raise ValueError(f"link {link} is no autopilot's; those are {sorted(self._autopilots)}")
        self._primary = link
        self._others.clear()

    def remove_link(self, link: int) -> None:
        """Close a link and forget what was learned on it."""
        del self._links[link]
        self._autopilots.discard(link)
        if link == self._primary:
            self._primary = min(self._autopilots, default=None)
        for key in [
            key for key, links in self._seen.items() if links.pop(link, None) is not None and not links
        ]:
            del self._seen[key]
        self._others.clear()

    def sent(self, raw: bytes) -> None:
        """We have sent this frame: when it comes back, it is a loop."""
        if len(self._own) == MAX_OWN:
            oldest = self._own[0]
            self._own_set[oldest] -= 1
            if not self._own_set[oldest]:
                del self._own_set[oldest]
        self._own.append(raw)
        self._own_set[raw] += 1

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
        if link in self._autopilots and sysid == self.sysid and compid == self.autopilot_compid:
            return True
        seen_ns = self._seen.get(sysid << 8 | compid, {}).get(link)
        return seen_ns is not None and now_ns - seen_ns <= self.route_expiry_ns

    def route(self, frame: Frame, source: int, now_ns: int) -> Route:
        """Decide one frame that came in on ``source`` and learn its sender."""
        _, msg_id, sysid, compid, target_system, _, _, _ = frame
        ours = sysid == self.sysid
        if ours and self._is_loop(frame, compid, source):
            route = _LOOP_ROUTE
        else:
            if sysid:
                seen = self._seen.get(sysid << 8 | compid)
                if seen is None:
                    seen = self._new_sender(sysid << 8 | compid)
                seen[source] = now_ns
            if msg_id in _LINK_LOCAL:
                route = _LINK_LOCAL_ROUTE
            elif target_system:
                route = self._targeted(frame, source, now_ns)
            elif msg_id == _SETUP_SIGNING:
                route = _LINK_LOCAL_ROUTE
            elif source in self._autopilots and self._comes_by_primary(sysid, compid, source, now_ns):
                route = _STANDBY_ROUTE
            elif msg_id == _HEARTBEAT:
                route = self._heartbeat(frame, source, now_ns)
            else:
                route = self._others.get(source) or self._broadcast(source)
        self.counters[route.outcome] += 1
        return route

    def _is_loop(self, frame: Frame, compid: int, source: int) -> bool:
        if compid == self.autopilot_compid:
            return source not in self._autopilots
        return compid == self.compid and frame.raw in self._own_set

    def _comes_by_primary(self, sysid: int, compid: int, source: int, now_ns: int) -> bool:
        """Whether what an autopilot's link brings comes by the one that is used, too."""
        primary = self._primary
        return primary is not None and source != primary and self.knows(primary, sysid, compid, now_ns)

    def _new_sender(self, key: int) -> dict[int, int]:
        if len(self._seen) >= MAX_LEARNED:
            self._forget_oldest()
        links: dict[int, int] = {}
        self._seen[key] = links
        return links

    def _forget_oldest(self) -> None:
        del self._seen[min(self._seen, key=lambda key: max(self._seen[key].values()))]

    def _heartbeat(self, frame: Frame, source: int, now_ns: int) -> Route:
        links = tuple(
            link
            for link in self._others_of(source)
            if not self.knows(link, frame.sysid, frame.compid, now_ns)
        )
        return Route(RoutingOutcome.HEARTBEAT, links, True)

    def _targeted(self, frame: Frame, source: int, now_ns: int) -> Route:
        system, component = frame.target_system, frame.target_component
        ours = system == self.sysid
        if ours and component:
            links = tuple(
                link for link in self._others_of(source) if self.knows(link, system, component, now_ns)
            )
        else:
            links = self._reaching_system(system, source, now_ns)
        if ours and component == self.compid:
            return Route(RoutingOutcome.TARGETED if links else RoutingOutcome.LOCAL, links, True)
        if ours and component and not links and self._primary is not None and source not in self._autopilots:
            links = (self._primary,)  # nobody has seen it: the autopilot decides
        to_us = ours and component == 0
        return Route(RoutingOutcome.TARGETED if links else RoutingOutcome.NO_ROUTE, links, to_us)

    def _reaching_system(self, system: int, source: int, now_ns: int) -> tuple[int, ...]:
        oldest_ns = now_ns - self.route_expiry_ns
        reached = {
            link
            for key, links in self._seen.items()
            if key >> 8 == system
            for link, seen_ns in links.items()
            if seen_ns >= oldest_ns
        }
        if system == self.sysid and self._primary is not None:
            reached.add(self._primary)
        return tuple(link for link in self._others_of(source) if link in reached)

    def _others_of(self, source: int) -> tuple[int, ...]:
        """Where a link's untargeted frames go."""
        return (self._others.get(source) or self._broadcast(source)).links

    def _broadcast(self, source: int) -> Route:
        """The way of a link's untargeted frames, worked out when one comes: links may come and go in hundreds."""
        if source not in self._links:
            return _NOBODY_ROUTE
        autopilots = self._autopilots
        beyond = set(autopilots) if source in autopilots else autopilots - {self._primary}
        others = tuple(link for link in self._links if link != source and link not in beyond)
        route = self._others[source] = Route(RoutingOutcome.BROADCAST, others, True)
        return route
