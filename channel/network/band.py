"""Networks of a run that are in one band: they live on one clock, and their frames are noise to each other."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations
from typing import NamedTuple

from channel.access.agenda import SharedClock
from channel.network.crossing import Crossing, NetworkSide
from channel.network.foreign_signals import Beside
from channel.network.network import Network


class Neighbour(NamedTuple):
    """A network of a run, and how others meet it."""

    network: Network
    side: NetworkSide


def share_band(networks: Sequence[Neighbour]) -> list[tuple[str, str]]:
    """Have networks that overlap in frequency disturb each other; nothing was sent over them yet.

    Args:
        networks: of a run, that take time on the air, in their order.

    Returns:
        Names of networks, whose frames reach whose receivers. The others stay as they are.
    """
    found = [
        (source, target, crossing)
        for source, target in permutations(range(len(networks)), 2)
        if (crossing := Crossing(networks[source].side, networks[target].side)).carries
    ]
    besides = {place: Beside(networks[place].network.access) for pair in found for place in pair[:2]}
    for source, target, crossing in found:
        besides[source].disturbs(besides[target], crossing)
    for place, beside in besides.items():
        networks[place].network.world.beside = beside
        networks[place].network.access.foresees_nothing()
    for group in _together([pair[:2] for pair in found]):
        SharedClock([networks[place].network.access.agenda for place in sorted(group)])
    return [(networks[source].side.name, networks[target].side.name) for source, target, _ in found]


def _together(pairs: Sequence[tuple[int, int]]) -> list[set[int]]:
    """Those that have to do with each other, if only by way of others."""
    groups: list[set[int]] = []
    for pair in pairs:
        one = set(pair)
        for group in [each for each in groups if each & one]:
            one |= group
            groups.remove(group)
        groups.append(one)
    return groups
