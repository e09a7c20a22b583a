"""The random terms of the ways from interferers and emitters to receivers: the laws of the radio's own links.

A term that lasts is a field over the places of both ends, which it shares with RF sensors that measure the same
emitter, and with the run's other networks; one that is drawn anew is keyed by the packet that is disturbed.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from channel.checks import FloatArray
from channel.draws import LinkDraws, Purpose, uniform_from_words
from channel.link.emitters.identity import interferer_names
from channel.link.radio import Radio
from channel.medium.links import LinksOfPass
from channel.medium.random_terms import RandomTerms


class InterfererTerms:
    """Draws of the sources that one radio hears in one run.

    Args:
        radio: at the receivers.
        draws: of the run's links.
    """

    def __init__(self, radio: Radio, draws: LinkDraws) -> None:
        self._radio = radio
        self._draws = draws
        self._names = (*interferer_names(radio.config), *(each.name for each in radio.emitters))
        everybody = LinkDraws(draws.draws.common, (*draws.nodes, *self._names))
        self._terms = RandomTerms(radio, everybody, "sensing")

    def gains_db(self, links: LinksOfPass) -> Sequence[FloatArray | float]:
        """Return what the terms add to the power of each source at the receivers, shape (L,) or one for all, dB."""
        return [self._of_source(number, links) for number in range(len(self._names))]

    def _of_source(self, number: int, links: LinksOfPass) -> FloatArray | float:
        way = self._radio.way_of_source(number, links.path)
        standing = None if links.velocity_rx_ned_mps is None else np.zeros_like(links.velocity_rx_ned_mps)
        ways = links._replace(
            tx=np.full_like(links.tx, len(self._draws.nodes) + number),
            path=way,
            distance_m=way.distance_m,
            velocity_tx_ned_mps=standing,
        )
        return self._terms.gain_db(ways, self._uniforms(number, links))

    def _uniforms(self, number: int, links: LinksOfPass) -> dict[Purpose, FloatArray]:
        purposes = self._terms.purposes[1:]
        if not purposes:
            return {}
        stream = ("interference", self._names[number])
        words = self._draws.words(stream, links.tx, links.rx, links.seq)
        return {each: uniform_from_words(words[each.word]) for each in purposes}
