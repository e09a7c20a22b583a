"""What stations take in of interferers and emitters while they listen: the power that frames have for noise there."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from channel.checks import FloatArray
from channel.draws import LinkDraws
from channel.link.radio import Radio
from channel.medium.interferer_terms import InterfererTerms
from channel.medium.links import LinksOfPass
from channel.medium.medium import Medium
from channel.medium.random_terms import RandomTerms
from channel.medium.reception import EVERYBODY, Packets
from channel.medium.stations.tracks import Snapshot
from channel.numbers.units import ratio_from_db

ANEW_NS = 5_000_000
"""So often it is looked where nodes are by now (20 m/s are 0.1 m), and what random terms are. What is drawn anew for
each packet is drawn anew for each of these spans."""
LEAST_SLOT_NS = 9_000
"""Sources that are on and off in shorter slots are looked at once in as many of them as this lasts."""


class MediumSources:
    """Sources of interference at the nodes of a medium, each by the radio and the antenna of the node.

    Args:
        medium: where the nodes and the emitters are, and the radios.
        slots_ns: lengths of the slots in which sources are on or off.
    """

    def __init__(self, medium: Medium, slots_ns: Sequence[int]) -> None:
        self._medium = medium
        steps = [slot_ns * -(-LEAST_SLOT_NS // slot_ns) for slot_ns in slots_ns]
        self._steps_ns = (ANEW_NS, *steps)
        kinds: dict[Radio, list[int]] = {}
        for node, radio in enumerate(medium.radios):
            if radio.sources:
                kinds.setdefault(radio, []).append(node)
        self._kinds = [_Kind(radio, nodes, medium) for radio, nodes in kinds.items()]
        self._at_ns, self._powers_mw = -1, [0.0] * len(medium.nodes)

    def span_ns(self, at_ns: int) -> tuple[int, int]:
        """From when to when nothing changes, about an instant."""
        begins = [at_ns // step_ns * step_ns for step_ns in self._steps_ns]
        ends = [begin_ns + step_ns for begin_ns, step_ns in zip(begins, self._steps_ns, strict=True)]
        return max(begins), min(ends)

    def powers_mw(self, at_ns: int) -> Sequence[float]:
        """Of all that is on, behind each node's filter; 0 while its radio is off, or its place is not known."""
        if at_ns != self._at_ns:
            self._at_ns, self._powers_mw = at_ns, self._taken_mw(at_ns)
        return self._powers_mw

    def _taken_mw(self, at_ns: int) -> list[float]:
        medium, emitters = self._medium, self._medium.emitters
        powers_mw = np.zeros(len(medium.nodes))
        if emitters.are_known:
            now, places = medium.at(at_ns), emitters.at(np.array([at_ns]), None) if emitters.names else {}
            for kind in self._kinds:
                powers_mw[kind.nodes] = kind.powers_mw(now, places, at_ns)
            powers_mw[medium.radios_off(at_ns) | ~medium.known] = 0.0
        found: list[float] = powers_mw.tolist()
        return found


class _Kind:
    """Nodes with one radio."""

    def __init__(self, radio: Radio, nodes: Sequence[int], medium: Medium) -> None:
        draws = LinkDraws(medium.draws, medium.nodes)
        self.nodes = np.array(nodes, dtype=np.intp)
        self._radio, self._terms = radio, RandomTerms(radio, draws)
        self._varying = InterfererTerms(radio, draws) if radio.interference_varies else None
        self._floor_mw = float(ratio_from_db(radio.noise_floor_dbm))
        self._bases = medium.bases[self.nodes]

    def powers_mw(self, now: Snapshot, places: dict[str, FloatArray], at_ns: int) -> FloatArray:
        """At the nodes of this kind."""
        links = self._links(now, places, at_ns)
        gains_db = None if self._varying is None else self._varying.gains_db(links)
        noise_dbm = self._radio.noise_dbm(links.path, self._terms.interferers_on(links), gains_db)
        return np.maximum(ratio_from_db(noise_dbm) - self._floor_mw, 0.0)

    def _links(self, now: Snapshot, places: dict[str, FloatArray], at_ns: int) -> LinksOfPass:
        """Each node as a link to itself, of which the receiving end counts; it and the span are the keys of draws."""
        nodes, count = self.nodes, self.nodes.size
        place, attitude, velocity = (
            None if each is None else each.take(nodes, axis=1).T
            for each in (now.position_ned_m, now.attitude_wxyz, now.velocity_ned_mps)
        )
        assert place is not None
        path = self._radio.path_of(place, place, np.zeros(count), attitude, attitude)
        path = path._replace(tx_is_base=self._bases, rx_is_base=self._bases, emitters_ned_m=places)
        columns = at_ns, 0, at_ns // ANEW_NS, 0, EVERYBODY
        span = Packets(*(np.array([each]) for each in columns))
        return LinksOfPass(
            span, np.zeros(count, dtype=np.intp), nodes, nodes, path, np.zeros(count), velocity, velocity
        )
