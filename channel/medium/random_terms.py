"""The random terms of links that last over time or place, and the losses that ask for the instant."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from channel.checks import FloatArray
from channel.draws import Draws, uniform_from_words
from channel.fading.link_words import LinkWords
from channel.fading.terms import LastingFading, LastingShadowing, LineOfSight
from channel.fading.waves import LinkPlaces, link_places
from channel.geometry import Path
from channel.link.radio import Radio, States

Index = NDArray[np.intp]
LEVEL = np.zeros(())


class RandomTerms:
    """Draws of one radio in one run.

    Args:
        radio: the radio.
        draws: the run's draws.
        nodes: names of all nodes.
    """

    def __init__(self, radio: Radio, draws: Draws, nodes: Sequence[str]) -> None:
        config = radio.config
        self._config = config
        self._draws = draws
        self._sight = radio.sight
        self._fields = LinkWords(draws.seed, nodes, "fields")
        self._bursts = LinkWords(draws.seed, nodes, "bursts")
        self._fading: LastingFading | None = None
        self._shadowing: LastingShadowing | None = None
        if config.fading.is_random and config.fading.coherence != "packet":
            self._fading = LastingFading(config.fading, draws, config.frequency_hz)
        if config.shadowing.is_random and config.shadowing.decorrelation_m is not None:
            self._shadowing = LastingShadowing(config.shadowing, draws)
        self._states = None if radio.sight is None else LineOfSight(draws, radio.sight.decorrelation_m)
        lasting = self._fading, self._shadowing, self._states
        self._asks_for_places = any(term is not None for term in lasting)

    def places(self, tx: Index, rx: Index, sim_time_ns: NDArray[np.int64], path: Path) -> LinkPlaces | None:
        """Return links as the lasting terms take them; None if there are none.

        Args:
            tx: index of each link's transmitter, shape (L,).
            rx: of its receiver.
            sim_time_ns: when the packets were sent, shape (L,).
            path: the links.
        """
        if not self._asks_for_places:
            return None
        assert path.position_tx_ned_m is not None
        assert path.position_rx_ned_m is not None
        return link_places(self._fields, tx, rx, path.position_tx_ned_m, path.position_rx_ned_m, sim_time_ns)

    def shadowing_db(
        self, places: LinkPlaces | None, path: Path, per_packet_normal: FloatArray | None
    ) -> FloatArray | float:
        """Return the loss by shadowing, and by the drawn line of sight beyond the link budget, dB, shape (L,).

        Args:
            places: the links, from `places`.
            path: the links.
            per_packet_normal: of shadowing that each packet draws anew; None: there is no such.
        """
        normal = per_packet_normal
        if self._shadowing is not None:
            assert places is not None
            normal = self._shadowing.standard_normal(places, path.distance_m)
        if self._sight is not None and self._states is not None:
            assert places is not None
            return self._sight.loss_db(path, self._states.standard_normal(places), normal)
        return 0.0 if normal is None else self._config.shadowing.loss_db(normal)

    def fading_db(
        self,
        places: LinkPlaces | None,
        path: Path,
        sim_time_ns: NDArray[np.int64],
        speed_mps: FloatArray,
    ) -> FloatArray | float:
        """Return the gain by fading that lasts, dB, shape (L,); 0 if each packet draws its own.

        Args:
            places: the links, from `places`.
            path: the links.
            sim_time_ns: when the packets were sent, shape (L,).
            speed_mps: relative speeds of the two ends.
        """
        if self._fading is None:
            return 0.0
        assert places is not None
        return self._fading.gain_db(places, sim_time_ns, path.distance_m, speed_mps, self._elevation(path))

    def fading_gain_db(self, first: FloatArray, second: FloatArray, path: Path) -> FloatArray:
        """Return the gain by fading for two uniform draws of each link, dB."""
        return self._config.fading.gain_db(first, second, self._elevation(path))

    def _elevation(self, path: Path) -> FloatArray:
        return path.elevation_deg if self._config.fading.by_elevation else LEVEL

    def interferers_on(self, sim_time_ns: int) -> States:
        """Return which interferers transmit at an instant: the same for every receiver."""
        return tuple(
            each.duty >= 1.0 or self._slot_draw(i, max(sim_time_ns // each.slot_ns, 0)) < each.duty
            for i, each in enumerate(self._config.interference.interferers)
        )

    def _slot_draw(self, index: int, slot: int) -> float:
        words = self._draws.words(("interferer", str(index), "slots"), slot, 1)
        return float(uniform_from_words(words[0, 0]))

    def burst_losses(
        self, tx: Index, rx: Index, sim_time_ns: NDArray[np.int64], uniform: FloatArray
    ) -> NDArray[np.bool_]:
        """Return which receivers lose a packet to a burst, shape (L,).

        Args:
            tx: index of each link's transmitter, shape (L,).
            rx: of its receiver.
            sim_time_ns: when the packets were sent, shape (L,).
            uniform: a draw of each packet and receiver.
        """
        words = self._bursts.of_direction(tx, rx)
        return np.asarray(uniform <= self._config.bursts.loss_at(words, sim_time_ns))
