"""What else arrives at a radio's receiver: its interferers, and the emitters of the run near its frequency."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from channel.antenna import to_body
from channel.checks import ChannelInputError, FloatArray
from channel.config import RadioConfig
from channel.fading.waves import lattice
from channel.geometry import LEVEL_WXYZ, Path, separation_m
from channel.link.budget import LinkBudget
from channel.link.emitters.emission import Emission
from channel.link.emitters.emitter import Emitter
from channel.link.paths import LinkPaths
from channel.link.rays import with_reflection
from channel.link.sight import Sight
from channel.numbers import special
from channel.phy.interference import Interferer, sum_dbm
from channel.phy.spectrum import captured_db, reaches

States = tuple[bool | NDArray[np.bool_], ...]
"""Which interferers and emitters transmit, for all links or by link."""
Gains = Sequence[FloatArray | float]
"""What shadowing, fading and the line of sight add to the power of each, dB."""
POINTS = 64
"""At which the law of what interferers send is taken where a table serves: probabilities within 0.01."""
E = TypeVar("E", bound=Emission)
DRAWS_OF_SOURCE = 4
"""Line of sight, shadowing, and two for fading."""


def heard(config: RadioConfig, emissions: Sequence[E]) -> tuple[E, ...]:
    """Return those of which the spectrum comes as near as the last row of a radio's filter."""
    rows = config.interference.filter_rows(config.bandwidth_hz)
    return tuple(
        each
        for each in emissions
        if reaches(each.frequency_hz - config.frequency_hz, each.bandwidth_hz, rows)
    )


class Disturbance:
    """Noise and everything that is not the wanted signal.

    Args:
        config: of the radio.
        emitters: of the run.
        paths: of links.
        budget: of links.
        sight: the states of the line of sight, if it is drawn.

    Attributes:
        emitters: those that it hears: their spectrum comes as near as the last row of the receiver's filter.
        sources: its interferers, then these.
        states: every combination of those that transmit, with its probability.

    Raises:
        ChannelInputError: more of them have a duty between 0 and 1 than can be averaged over.
    """

    def __init__(
        self,
        config: RadioConfig,
        emitters: Sequence[Emitter],
        paths: LinkPaths,
        budget: LinkBudget,
        sight: Sight | None,
    ) -> None:
        law = config.interference
        self._config = config
        self._paths, self._budget, self._sight = paths, budget, sight
        self._floor_dbm = config.noise_floor_dbm
        rows = law.filter_rows(config.bandwidth_hz)
        self.emitters = heard(config, emitters)
        self.sources: tuple[Interferer | Emitter, ...] = (*law.interferers, *self.emitters)
        self.states = law.states([each.duty for each in self.emitters])
        self._carriers_hz = [each.frequency_hz or config.frequency_hz for each in self.sources]
        self._captured_db = [
            captured_db(carrier_hz - config.frequency_hz, each.bandwidth_hz, rows)
            for each, carrier_hz in zip(self.sources, self._carriers_hz, strict=True)
        ]
        is_random = config.shadowing.is_random or config.fading.is_random or sight is not None
        self.varies = bool(self.sources) and is_random

    def noise_dbm(
        self, path: Path, transmitting: States | None = None, gains_db: Gains | None = None
    ) -> FloatArray | float:
        """Return noise floor and interference at the receivers, dBm.

        Args:
            path: the links.
            transmitting: which sources are on, for all links or by link; all of them if not given.
            gains_db: what random terms add to each; if not given none, and the mean in watt over the line of sight.
        """
        if not self.sources:
            return self._floor_dbm
        on = (True,) * len(self.sources) if transmitting is None else transmitting
        powers = []
        for number, is_on in enumerate(on):
            if is_on is not False:
                way = self.way(number, path)
                gain_db = self._mean_gain_db(way) if gains_db is None else gains_db[number]
                powers.append(np.where(is_on, self._mean_dbm(number, way) + gain_db, -np.inf))
        return sum_dbm(self._floor_dbm, powers)

    def cases(
        self, path: Path, points: int = POINTS
    ) -> Iterator[tuple[float, Sequence[FloatArray | float] | FloatArray]]:
        """Yield the noise at the receivers, by who transmits: its probability, and the noise in cases alike likely.

        Args:
            path: the links.
            points: of a lattice over the random terms, a case each; without these there is one case.
        """
        for chance, on in self.states:
            if self.varies and any(on):
                yield chance, self._over_lattice(path, on, points)
            else:
                yield chance, (self.noise_dbm(path, on),)

    def _over_lattice(self, path: Path, on: States, points: int) -> FloatArray:
        """Return the noise at each point of a lattice, shape (points, ...)."""
        active = [number for number, is_on in enumerate(on) if is_on]
        columns = (points, DRAWS_OF_SOURCE, *(1,) * path.distance_m.ndim)
        uniform = lattice(points, DRAWS_OF_SOURCE * len(active))
        powers = []
        for number, part in zip(active, np.split(uniform, len(active), axis=1), strict=True):
            way = self.way(number, path)
            gain_db = self._gain_db(way, np.moveaxis(part.reshape(columns), 1, 0))
            powers.append(self._mean_dbm(number, way) + gain_db)
        return sum_dbm(self._floor_dbm, powers)

    def way(self, number: int, path: Path) -> Path:
        """Return the geometry from a source to the receivers of `path`."""
        assert path.position_rx_ned_m is not None
        place = np.broadcast_to(_place_of(self.sources[number], path), path.position_rx_ned_m.shape)
        distance_m = separation_m(place, path.position_rx_ned_m)
        carrier_hz, attitude = self._carriers_hz[number], path.attitude_rx_wxyz
        way = self._paths.of(place, path.position_rx_ned_m, distance_m, None, attitude, carrier_hz)
        return way._replace(tx_is_base=np.logical_not(path.rx_is_base), rx_is_base=path.rx_is_base)

    def _mean_dbm(self, number: int, way: Path) -> FloatArray:
        """Return the power of a source behind the receiver's filter, without random terms."""
        config, source = self._config, self.sources[number]
        antenna = source.antenna if isinstance(source, Emitter) else None
        attitude = LEVEL_WXYZ if way.attitude_rx_wxyz is None else way.attitude_rx_wxyz
        gain_db = config.receiving_antenna.towards_db(to_body(attitude, -way.way_ned))
        if antenna is not None:
            gain_db = gain_db + antenna.towards_db(way.way_ned)
        way = with_reflection(way, config.propagation, antenna, config.receiving_antenna)
        received_db = gain_db + config.offset_db - config.receiving_cable_loss_db + self._captured_db[number]
        return np.asarray(source.power_dbm + received_db - self._budget.loss_db(way))

    def _mean_gain_db(self, way: Path) -> FloatArray | float:
        return 0.0 if self._sight is None else self._sight.mean_gain_db(way)

    def _gain_db(self, way: Path, uniform: FloatArray) -> FloatArray | float:
        """Return what the random terms add for draws of shape (DRAWS_OF_SOURCE, ...)."""
        shadowing, fading = self._config.shadowing, self._config.fading
        sight_normal, shadow_normal = special.ndtri(uniform[:2])
        gain_db: FloatArray | float = 0.0
        if self._sight is not None:
            gain_db = -self._sight.loss_db(way, sight_normal, shadow_normal)
        elif shadowing.is_random:
            gain_db = -shadowing.loss_db(np.asarray(shadow_normal))
        if fading.is_random:
            elevation = way.elevation_deg if fading.by_elevation else np.zeros(())
            gain_db = gain_db + fading.gain_db(uniform[2], uniform[3], elevation)
        return gain_db


def _place_of(source: Interferer | Emitter, path: Path) -> FloatArray:
    if isinstance(source, Interferer):
        return np.asarray(source.position_ned_m)
    if path.emitters_ned_m is None or source.name not in path.emitters_ned_m:
        raise ChannelInputError("emitters_ned_m", path.emitters_ned_m, f"a place of emitter {source.name}")
    return path.emitters_ned_m[source.name]
