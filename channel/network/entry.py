"""When a packet enters its radio: agents act at ticks, radios do not.

Without this all nodes would transmit at the same instant for ever. Each node has a phase within the tick, and each
packet takes the computer some time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from channel.access.timing import NS_PER_S
from channel.access.words import WordStream
from channel.draws import Draws

FIRST_EXACT: Final = 1 << 40
"""Packets with this number and higher ones are a device's, not an agent's: they enter at the instant that they say."""


@dataclass(frozen=True, slots=True)
class EntrySettings:
    """Of all nodes.

    Attributes:
        phase_s: of each node within the tick; None: drawn from 0 to a tick.
        processing_s: between an agent's word and its radio, at least.
        spread_s: up to so much is added to it, drawn for each packet.
    """

    phase_s: float | None = None
    processing_s: float = 0.0
    spread_s: float = 0.0


class EntryInstants:
    """Instants at which packets enter radios.

    Args:
        nodes: ids of all nodes.
        settings: of all nodes.
        tick_period_ns: sim time between ticks.
        draws: of the run.

    Attributes:
        phases_ns: of each node.
    """

    def __init__(
        self, nodes: Sequence[str], settings: EntrySettings, tick_period_ns: int, draws: Draws
    ) -> None:
        self._least_ns = round(settings.processing_s * NS_PER_S)
        self._spread_ns = round(settings.spread_s * NS_PER_S)
        self._words = [WordStream(draws, node, "processing") for node in nodes]
        if settings.phase_s is None:
            phases = [WordStream(draws, node, "phase").uniform(0) * tick_period_ns for node in nodes]
        else:
            phases = [settings.phase_s * NS_PER_S] * len(nodes)
        self.phases_ns = [round(phase) for phase in phases]
        self._latest_ns = [0] * len(nodes)

    def at_ns(self, node: int, number: int, sim_time_ns: int) -> int:
        """When a packet enters: packets of a node's agent keep their order."""
        if number >= FIRST_EXACT:
            return sim_time_ns
        spread_ns = int(self._words[node].uniform(number) * self._spread_ns) if self._spread_ns else 0
        at_ns = sim_time_ns + self.phases_ns[node] + self._least_ns + spread_ns
        self._latest_ns[node] = at_ns = max(at_ns, self._latest_ns[node])
        return at_ns
