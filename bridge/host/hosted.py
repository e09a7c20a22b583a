"""The nodes of a process: made from what the scenario says of them, and ended together."""

from __future__ import annotations

import logging
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import ExitStack
from time import monotonic
from types import MappingProxyType
from typing import Final

from aps.links.kinds.called import CalledClient
from bridge.agents.outlet import NodeOutlet
from bridge.host.hosted_aircraft import HostedAircraft
from bridge.host.hosted_ground import HostedGround
from bridge.host.hosted_node import HostedNode
from bridge.run.directory import RunDirectory
from bridge.run.process import log_clock
from bridge.scenario.nodes import Aircraft, GroundNode
from bridge.timeouts import AGENT_END_S

log = logging.getLogger("host")
NO_SERIALS: Final[Mapping[int, CalledClient]] = MappingProxyType({})


def hosted_node(
    run: RunDirectory,
    node: str,
    outlet: NodeOutlet,
    autopilot: CalledClient | None = None,
    serials: Mapping[int, CalledClient] = NO_SERIALS,
) -> HostedNode:
    """The node with this id, to be entered.

    Args:
        run: the run.
        node: id of a UA or of a ground node.
        outlet: where what it says goes.
        autopilot: of a UA, if it is in this process.
        serials: further serial ports of that, by number.
    """
    config = run.scenario.node(node)
    if isinstance(config, Aircraft):
        return HostedAircraft(run, config, outlet, autopilot, serials)
    assert isinstance(config, GroundNode), "emitters have no host"
    return HostedGround(run, config, outlet)


class Hosted:
    """The nodes of a process at the instants at which the fleet is held.

    Args:
        nodes: entered already.
        on_exchanged: with lookahead, reported an instant from which all their aircraft may fly on.
    """

    def __init__(self, nodes: Sequence[HostedNode], on_exchanged: Callable[[int], object]) -> None:
        self.nodes = tuple(nodes)
        self._by_id = {one.id: one for one in nodes}
        self._on_exchanged = on_exchanged
        self._sim_time_ns, self._missing = 0, set[str]()
        for one in nodes:
            one.on_exchanged = self._exchanged

    def hold(self, sim_time_ns: int, *, is_tick: bool, stalled: Collection[str] = ()) -> None:
        """The fleet is held at an instant: exchange MAVLink with all autopilots, then have all nodes live through it.

        Args:
            sim_time_ns: the instant.
            is_tick: a tick, or an exchange of MAVLink between two.
            stalled: nodes whose autopilots physics does not wait for.
        """
        self._sim_time_ns = log_clock.now_ns = sim_time_ns
        self._missing = {one.id for one in self.nodes}
        for one in self.nodes:
            one.hold(sim_time_ns, absent=one.id in stalled)
        for one in self.nodes:
            one.live(sim_time_ns, is_tick=is_tick)

    def serial_came(self, node: str, radio: str, at_ns: int, data: bytes) -> None:
        """Bytes have come out of a node's modem."""
        self._by_id[node].serial_came(radio, at_ns, data)

    def _exchanged(self, node: str) -> None:
        self._missing.discard(node)
        if not self._missing:
            self._on_exchanged(self._sim_time_ns)


def stop_all(hosted: Sequence[HostedNode]) -> None:
    """End all agents together, and write what is left of every record, whatever an agent does on its way out."""
    runners = [one.runner for one in hosted if one.runner is not None]
    for runner in runners:
        runner.ask_to_stop()
    until = monotonic() + AGENT_END_S
    for runner in runners:
        if not runner.join(until - monotonic()):
            log.warning("the agent of node %s did not end", runner.ua.node)
    with ExitStack() as closing:
        for one in hosted:
            closing.callback(one.close)
