"""What the live view knows of a run: a plain class that is fed with messages. No I/O, no clock.

It is an observer's picture: what was published before somebody looked is not in it, unless messages carry totals.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from bridge.bus.messages import AgentStatus, AircraftState, Clock, Fates, Links, Message, Truth, Truths
from bridge.scenario.model import Scenario
from bridge.scenario.nodes import MAIN
from bridge.scenario.resolve.partitions import partitions_of
from bridge.scenario.resolve.radio import config_of
from channel.medium.stations.partitions import Partition, Partitions
from channel.routing.settings import NoRouting
from lostlink.view.picture.air_history import AirHistory
from lostlink.view.picture.link_history import VALUES_MAX, LinkHistory
from lostlink.view.picture.logged import Logged
from lostlink.view.picture.losses import Losses
from lostlink.view.picture.networks import by_network

TRAIL_PERIOD_NS = 500_000_000
"""Between two points of a trail, sim time."""
TRAIL_POINTS = 240
LATELY_S = 5.0
"""Sim time for which a packet says how good a link is where packets go by another radio network since."""
MARKS_MAX = 400
"""Links with losses that are shown as they happen, per frame."""
NEWS_KEPT = 200
"""Lines of what agents and operators said."""
Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class NodeInfo:
    """A node as the scenario has it."""

    id: str
    kind: Literal["ua", "ground"]
    title: str
    detail: str = ""
    takes_commands: bool = True
    """Whether a host of the run has it; a ground node without an agent of ours has none."""


@dataclass(frozen=True, slots=True)
class EmitterInfo:
    """An RF emitter as the scenario has it."""

    id: str
    frequency_hz: float
    power_dbm: float


@dataclass(slots=True)
class NodeNews:
    """What a node reported last.

    Attributes:
        state: of its autopilot; None before the first.
        agent: what its agent said of itself.
    """

    state: AircraftState | None = None
    agent: AgentStatus | None = None


@dataclass(frozen=True, slots=True)
class NewsLine:
    """Something that somebody said: at when, who, what."""

    sim_time_ns: int
    node: str
    text: str


class FleetView:
    """The picture of one run.

    Args:
        nodes: all nodes, in the order of their indices.
        duration_s: sim time at which the run ends at the latest.
        emitters: of the scenario.
        now_s: wall time, by which sim time may stand still.
        networks: names of the radio networks.
        routed: those whose nodes hand packets on.
        members: ids of the nodes that are on a network, where these are not all.
        partitions: of the nodes.
    """

    def __init__(
        self,
        nodes: Sequence[NodeInfo],
        duration_s: float,
        emitters: Sequence[EmitterInfo] = (),
        now_s: Callable[[], float] = lambda: 0.0,
        networks: Sequence[str] = (MAIN,),
        routed: Set[str] = frozenset(),
        members: Mapping[str, Set[str]] = MappingProxyType({}),
        partitions: Sequence[Partition] = (),
    ) -> None:
        self.nodes = tuple(nodes)
        self.emitters = tuple(emitters)
        self.duration_s = duration_s
        self.index = {node.id: number for number, node in enumerate(self.nodes)}
        self._emitter_index = {emitter.id: number for number, emitter in enumerate(self.emitters)}
        self._now_s = now_s
        self.networks, self._routed, self._members = tuple(networks), routed, members
        self._partitions = Partitions(tuple(self.index), partitions)
        self.times_forgotten = 0
        """How often all was forgotten: whoever shows what is new begins anew then."""
        self._begin()

    def _begin(self) -> None:
        self.clock = Clock()
        self._clock_s = self._now_s()
        self.is_over = False
        values_max = VALUES_MAX // len(self.networks)
        self.links = {
            name: LinkHistory(len(self.nodes), values_max, self._partitions) for name in self.networks
        }
        """By radio network."""
        self.logged = Logged(tuple(self.index))
        self.news = {node.id: NodeNews() for node in self.nodes}
        self.lines: deque[NewsLine] = deque(maxlen=NEWS_KEPT)
        self.lines_told = 0
        """How many lines there have been; the newest are in `lines`."""
        self.radios_off: frozenset[int] = frozenset()
        """Nodes whose radios are off, by the newest report of links."""
        shape = (len(self.nodes), 3)
        self.position_ned_m: Floats = np.full(shape, np.nan)
        self.velocity_ned_mps: Floats = np.full(shape, np.nan)
        self.wind_ned_mps: Floats = np.full(shape, np.nan)
        self.heading_rad: Floats = np.full(len(self.nodes), np.nan)
        self.emitter_position_ned_m: Floats = np.full((len(self.emitters), 3), np.nan)
        self.trail: deque[Floats] = deque(maxlen=TRAIL_POINTS)
        """Positions of all nodes, every TRAIL_PERIOD_NS."""
        self.trail_points = 0
        """How many points the trail has had."""
        self.look_anew()
        self._handlers: dict[type[Message], Callable[[Any], None]] = {
            Clock: self._take_clock,
            Truths: self._take_truths,
            Links: self._take_links,
            Fates: self._take_fates,
            AgentStatus: self._take_agent,
            AircraftState: self._take_state,
        }

    def forget(self) -> None:
        """Be as at first."""
        self._begin()
        self.times_forgotten += 1

    @property
    def sim_time_ns(self) -> int:
        """Sim time of the newest tick."""
        return self.clock.header.stamp.ns

    @property
    def still_s(self) -> float:
        """For how long a tick is due, s of wall time: 0 before the first, in a pause, at the end."""
        if self.is_over or self.clock.paused or not self.sim_time_ns:
            return 0.0
        return self._now_s() - self._clock_s

    def take(self, message: Message, node: str = "") -> None:
        """Take a message; ``node`` is whose it is, by its key. What is of unknown kinds or nodes is ignored."""
        if isinstance(message, AgentStatus | AircraftState):
            if node in self.news:
                self._handlers[type(message)]((node, message))
        elif type(message) in self._handlers:
            self._handlers[type(message)](message)

    def tell(self, node: str, text: str) -> None:
        """Add a line to what was said."""
        self.lines.append(NewsLine(self.sim_time_ns, node, text))
        self.lines_told += 1

    def end(self) -> None:
        """The run is over: the picture stays as it is."""
        if not self.is_over:
            self.is_over = True
            self.tell("", "the run is over")

    def look_anew(self) -> None:
        """Forget what is followed only while somebody looks: what came between was not seen."""
        self.losses = {name: Losses(len(self.nodes)) for name in self.networks}
        """By radio network."""
        self.air = AirHistory(len(self.nodes), self._routed)
        self.trail.clear()
        self._trail_ns = -TRAIL_PERIOD_NS

    def is_on(self, node: int, network: str) -> bool:
        """Whether a node is on a radio network."""
        return self.nodes[node].id in self._members.get(network, self.index)

    def are_apart(self, node: int, other: int) -> bool:
        """Whether a partition is between two nodes now."""
        return self._partitions.are_apart(node, other, self.sim_time_ns)

    def pairs(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Return tx and rx of all links that have carried a packet on any network."""
        tx, rx = np.nonzero(np.any([links.carried for links in self.links.values()], axis=0))
        return tx, rx

    def probability(self) -> Floats:
        """[tx, rx]: recent mean of 1 - PER of each link, on the network where it is greatest; NaN if there is none.

        A network on which the link has carried nothing for LATELY_S before its latest packet says nothing of it.
        """
        newest_s = np.fmax.reduce([links.newest_s for links in self.links.values()])
        best: Floats = np.fmax.reduce(
            [
                np.where(links.newest_s >= newest_s - LATELY_S, links.probability, np.nan)
                for links in self.links.values()
            ]
        )
        return best

    def fresh_losses(self) -> list[tuple[int, int, int]]:
        """Return (tx, rx, packets) of what was lost since the last call, those with most losses first."""
        fresh = sum((losses.fresh() for losses in self.losses.values()), Counter[tuple[int, int]]())
        return [(tx, rx, count) for (tx, rx), count in fresh.most_common(MARKS_MAX)]

    def _take_clock(self, clock: Clock) -> None:
        if clock.header.stamp.ns < self.sim_time_ns:  # the pace changed a tick ago
            clock = replace(clock, header=self.clock.header)
        self.clock, self._clock_s = clock, self._now_s()

    def _take_fates(self, fates: Fates) -> None:
        for name, each in by_network(fates):
            self.losses[name].take(each)
        self.air.take(fates)

    def _take_links(self, links: Links) -> None:
        if len(links.node) == len(self.nodes):
            for name, each in by_network(links):
                self.links[name].take(each)
            before, self.radios_off = self.radios_off, frozenset(map(int, links.radio_off))
            for number in sorted(before ^ self.radios_off):
                self.tell(self.nodes[number].id, f"radio {'off' if number in self.radios_off else 'on'}")

    def _take_truths(self, truths: Truths) -> None:
        for truth in truths.truth:
            number = self.index.get(truth.header.frame_id)
            emitter = self._emitter_index.get(truth.header.frame_id)
            if number is not None:
                self._take_truth(number, truth)
            elif emitter is not None:
                self.emitter_position_ned_m[emitter] = truth.position_ned_m.xyz
        now_ns = truths.header.stamp.ns
        if now_ns - self._trail_ns >= TRAIL_PERIOD_NS:
            self._trail_ns = now_ns
            self.trail.append(self.position_ned_m.copy())
            self.trail_points += 1

    def _take_truth(self, number: int, truth: Truth) -> None:
        self.position_ned_m[number] = truth.position_ned_m.xyz
        self.velocity_ned_mps[number] = truth.velocity_ned_mps.xyz
        self.wind_ned_mps[number] = truth.wind_ned_mps.xyz
        q = truth.attitude
        self.heading_rad[number] = np.arctan2(
            2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y * q.y + q.z * q.z)
        )

    def _take_agent(self, item: tuple[str, AgentStatus]) -> None:
        node, status = item
        before = self.news[node].agent
        self.news[node].agent = status
        if before is None or before.activity != status.activity:
            self.tell(node, status.activity)

    def _take_state(self, item: tuple[str, AircraftState]) -> None:
        node, state = item
        before = self.news[node].state
        self.news[node].state = state
        if before is not None and state.mode and before.mode != state.mode:  # a new boot has none at first
            self.tell(node, f"mode {state.mode}")


def view_of(scenario: Scenario, now_s: Callable[[], float] = lambda: 0.0) -> FleetView:
    """The empty picture of a run of ``scenario``; ``now_s`` says wall time, if the run is flown now."""
    nodes = [NodeInfo(ua.node, "ua", scenario.title(ua.node), ua.airframe) for ua in scenario.ua]
    nodes += [
        NodeInfo(node.node, "ground", scenario.title(node.node), takes_commands=node.has_agent)
        for node in scenario.ground
    ]
    order = {node: number for number, node in enumerate(scenario.stations)}
    emitters = [EmitterInfo(each.node, each.frequency_hz, each.power_dbm) for each in scenario.emitters]
    return FleetView(
        sorted(nodes, key=lambda node: order[node.id]),
        scenario.duration_s,
        emitters,
        now_s,
        scenario.network_names,
        frozenset(_routed(scenario)),
        {name: {node.node for node in scenario.nodes_on(name)} for name in scenario.network_names},
        partitions_of(scenario),
    )


def _routed(scenario: Scenario) -> Iterator[str]:
    """Radio networks whose nodes hand packets on; nodes of one have one way of routing."""
    first = next((node.radio for node in scenario.transceivers), None)
    for name in scenario.network_names:
        setting = (first or scenario.radio) if name == MAIN else scenario.networks[name]
        if not isinstance(config_of(setting).routing, NoRouting):
            yield name
