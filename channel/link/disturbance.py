"""What else arrives at a radio's receiver: its interferers, and the emitters of the run near its frequency."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from channel.antenna import to_body
from channel.checks import ChannelInputError, FloatArray
from channel.config import RadioConfig
from channel.geometry import LEVEL_WXYZ, Path, separation_m
from channel.link.emitter import Emitter
from channel.link.rays import with_reflection
from channel.phy.interference import Interferer, sum_dbm

States = tuple[bool | NDArray[np.bool_], ...]
"""Which interferers and emitters transmit, for all links or by link."""


class Way(Protocol):
    """The way as the radio counts it."""

    def path_of(
        self,
        tx_ned_m: FloatArray,
        rx_ned_m: FloatArray,
        distance_m: FloatArray,
        attitude_tx_wxyz: FloatArray | None = None,
        attitude_rx_wxyz: FloatArray | None = None,
        frequency_hz: FloatArray | float | None = None,
    ) -> Path:
        """Return the geometry of positions that are known to be good."""
        ...

    def loss_db(self, path: Path, /) -> FloatArray:
        """Return what the way takes, dB."""
        ...


class Disturbance:
    """Noise and everything that is not the wanted signal.

    Args:
        config: of the radio.
        emitters: of the run.
        way: of the radio.

    Attributes:
        emitters: those that it hears: no farther off in frequency than the last row of `interference.rejection`.
        sources: its interferers, then these.
        states: every combination of those that transmit, with its probability.

    Raises:
        ChannelInputError: more of them have a duty between 0 and 1 than can be averaged over.
    """

    def __init__(self, config: RadioConfig, emitters: Sequence[Emitter], way: Way) -> None:
        law = config.interference
        self._config = config
        self._way = way
        self._floor_dbm = config.noise.noise_floor_dbm(config.bandwidth_hz)
        self.emitters = tuple(
            each for each in emitters if law.reaches(each.frequency_hz - config.frequency_hz)
        )
        self.sources: tuple[Interferer | Emitter, ...] = (*law.interferers, *self.emitters)
        self.states = law.states([each.duty for each in self.emitters])

    def noise_dbm(self, path: Path, transmitting: States | None = None) -> FloatArray | float:
        """Return noise floor and interference at the receivers, dBm.

        Args:
            path: the links.
            transmitting: which sources are on, for all links or by link; all of them if not given.
        """
        if not self.sources:
            return self._floor_dbm
        on = (True,) * len(self.sources) if transmitting is None else transmitting
        powers = [
            np.where(is_on, self._arriving_dbm(each, path), -np.inf)
            for each, is_on in zip(self.sources, on, strict=True)
            if is_on is not False
        ]
        return sum_dbm(self._floor_dbm, powers)

    def _arriving_dbm(self, source: Interferer | Emitter, path: Path) -> FloatArray:
        """Return the mean power of one source at the receivers of `path`, after adjacent-channel rejection."""
        assert path.position_rx_ned_m is not None
        config = self._config
        antenna = source.antenna if isinstance(source, Emitter) else None
        place = _place_of(source, path)
        carrier = config.frequency_hz if source.frequency_hz is None else source.frequency_hz
        distance = separation_m(place, path.position_rx_ned_m)
        way = self._way.path_of(place, path.position_rx_ned_m, distance, None, path.attitude_rx_wxyz, carrier)
        attitude = LEVEL_WXYZ if path.attitude_rx_wxyz is None else path.attitude_rx_wxyz
        gain_db = config.receiving_antenna.towards_db(to_body(attitude, -way.way_ned))
        if antenna is not None:
            gain_db = gain_db + antenna.towards_db(way.way_ned)
        offset_hz = 0.0 if source.frequency_hz is None else carrier - config.frequency_hz
        way = with_reflection(way, config.propagation, antenna, config.receiving_antenna)
        received_db = gain_db + config.offset_db - config.receiving_cable_loss_db
        kept_db = received_db - config.interference.rejection_db(offset_hz)
        return np.asarray(source.power_dbm + kept_db - self._way.loss_db(way))


def _place_of(source: Interferer | Emitter, path: Path) -> FloatArray:
    if isinstance(source, Interferer):
        return np.asarray(source.position_ned_m)
    if path.emitters_ned_m is None or source.name not in path.emitters_ned_m:
        raise ChannelInputError("emitters_ned_m", path.emitters_ned_m, f"a place of emitter {source.name}")
    return path.emitters_ned_m[source.name]
