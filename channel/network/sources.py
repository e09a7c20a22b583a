"""What stations take in of interferers and emitters while they listen: the power that frames have for noise there."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from channel.checks import FloatArray
from channel.draws import LinkDraws
from channel.link.radio import Radio
from channel.medium.interferer_terms import InterfererTerms
from channel.medium.links import Indices, LinksOfPass
from channel.medium.medium import Medium
from channel.medium.random_terms import RandomTerms
from channel.medium.reception import EVERYBODY, Packets
from channel.medium.stations.tracks import Snapshot
from channel.numbers.units import ratio_from_db

ANEW_NS = 5_000_000
"""So often it is looked where nodes are by now (20 m/s are 0.1 m), and what random terms are; and when a station begins
to listen, which may be within such a span. What is drawn anew for each packet is drawn anew for each of these spans."""
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
        kinds = {radio: _Kind(radio, medium) for radio in {*medium.radios} if radio.sources}
        self._kinds = [kinds.get(radio) for radio in medium.radios]
        """By node; None: nothing disturbs it."""

    def span_ns(self, at_ns: int) -> tuple[int, int]:
        """From when to when no slot begins, and it is not looked anew where nodes are, about an instant."""
        begins = [at_ns // step_ns * step_ns for step_ns in self._steps_ns]
        ends = [begin_ns + step_ns for begin_ns, step_ns in zip(begins, self._steps_ns, strict=True)]
        return max(begins), min(ends)

    def powers_mw(self, nodes: Sequence[int], at_ns: int) -> Sequence[float]:
        """Of all that is on, behind each node's filter; 0 while its radio is off, or its place is not known.

        Of such nodes nothing is reckoned: a law may refuse what it is not for.
        """
        medium, emitters = self._medium, self._medium.emitters
        powers_mw = dict.fromkeys(nodes, 0.0)
        by_kind: dict[_Kind, list[int]] = {}
        known = medium.known
        for node in nodes if emitters.are_known else ():
            kind = self._kinds[node]
            if kind is not None and known[node] and not medium.radio_off(node, at_ns):
                by_kind.setdefault(kind, []).append(node)
        if by_kind:
            now, places = medium.at(at_ns), emitters.at(np.array([at_ns]), None) if emitters.names else {}
            for kind, there in by_kind.items():
                taken_mw = kind.powers_mw(np.array(there, dtype=np.intp), now, places, at_ns)
                powers_mw.update(zip(there, taken_mw.tolist(), strict=True))
        return list(powers_mw.values())


class _Kind:
    """Nodes with one radio."""

    def __init__(self, radio: Radio, medium: Medium) -> None:
        draws = LinkDraws(medium.draws, medium.nodes)
        self._radio, self._terms = radio, RandomTerms(radio, draws)
        self._varying = InterfererTerms(radio, draws) if radio.interference_varies else None
        self._floor_mw = float(ratio_from_db(radio.noise_floor_dbm))
        self._bases = medium.bases

    def powers_mw(
        self, nodes: Indices, now: Snapshot, places: dict[str, FloatArray], at_ns: int
    ) -> FloatArray:
        """At some nodes of this kind."""
        links = self._links(nodes, now, places, at_ns)
        gains_db = None if self._varying is None else self._varying.gains_db(links)
        noise_dbm = self._radio.noise_dbm(links.path, self._terms.interferers_on(links), gains_db)
        return np.maximum(ratio_from_db(noise_dbm) - self._floor_mw, 0.0)

    def _links(self, nodes: Indices, now: Snapshot, places: dict[str, FloatArray], at_ns: int) -> LinksOfPass:
        """Each node as a link to itself, of which the receiving end counts; it and the span are the keys of draws."""
        count, bases = nodes.size, self._bases[nodes]
        place, attitude, velocity = (
            None if each is None else each.take(nodes, axis=1).T
            for each in (now.position_ned_m, now.attitude_wxyz, now.velocity_ned_mps)
        )
        assert place is not None
        path = self._radio.paths.of(place, place, np.zeros(count), attitude, attitude)
        path = path._replace(tx_is_base=bases, rx_is_base=bases, emitters_ned_m=places)
        columns = at_ns, 0, at_ns // ANEW_NS, 0, EVERYBODY
        span = Packets(*(np.array([each]) for each in columns))
        return LinksOfPass(
            span, np.zeros(count, dtype=np.intp), nodes, nodes, path, np.zeros(count), velocity, velocity
        )
