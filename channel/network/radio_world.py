"""A world whose powers and errors are those of a radio of `channel.link`: nodes that stand still."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from channel.access.packets import AirFrame
from channel.access.timing import NS_PER_S
from channel.access.words import FrameDraws
from channel.access.world import Arrival, FrameArrivals, Piece, Rows
from channel.checks import FloatArray
from channel.link.radio import Radio
from channel.medium.stations.tracks import FOREVER
from channel.numbers.units import SPEED_OF_LIGHT_MPS, db_from_ratio, ratio_from_db

HEARD_DB = -20.0
"""A signal so far below the noise, or further, is no signal, and no interference either."""


class StandingSources:
    """Sources that never pause, at nodes that stand.

    Args:
        powers_mw: of all together, by node.
    """

    def __init__(self, powers_mw: Mapping[int, float]) -> None:
        self._powers_mw = powers_mw

    @classmethod
    def of(cls, radio: Radio, places_ned_m: Mapping[int, Sequence[float]]) -> StandingSources | None:
        """Those of a radio that nodes at some places have; None: there are none that never pause."""
        on = tuple(source.duty >= 1.0 for source in radio.sources)
        if not any(on):
            return None
        floor_mw = float(ratio_from_db(radio.noise_floor_dbm))
        there = {
            node: radio.path(position_tx_ned_m=place, position_rx_ned_m=place)
            for node, place in places_ned_m.items()
        }
        return cls(
            {node: float(ratio_from_db(radio.noise_dbm(path, on))) - floor_mw for node, path in there.items()}
        )

    def span_ns(self, at_ns: int) -> tuple[int, int]:
        """All time."""
        del at_ns
        return 0, FOREVER

    def powers_mw(self, nodes: Sequence[int], at_ns: int) -> Sequence[float]:
        """At some nodes."""
        del at_ns
        return [self._powers_mw[node] for node in nodes]


class RadioWorld:
    """Nodes at fixed places, all with one radio; powers are means, without shadowing and fading; there are no bursts.

    A frame's errors are by pieces of constant SINR: the share of its bits in each has the packet error rate of a
    packet of so many bytes at that SINR, and the frame comes through if all of them do, less the radio's base loss.

    Args:
        radio: of all nodes.
        places_ned_m: of each, in a common frame whose origin is on the ground.
        seed: of the draws.
    """

    def __init__(self, radio: Radio, places_ned_m: Mapping[int, Sequence[float]], seed: int = 1) -> None:
        self.nodes = tuple(sorted(places_ned_m))
        self._radio, self._draws = radio, FrameDraws(seed)
        self._kept = 1.0 - radio.config.base_loss
        self._noise_mw: dict[tuple[int, int], float] = {}
        reach: dict[int, list[Arrival]] = {tx: [] for tx in self.nodes}
        self.longest_delay_ns = 0
        """Of any way."""
        for tx in self.nodes:
            for rx in self.nodes:
                if tx != rx:
                    reach[tx] += self._join((tx, rx), places_ned_m[tx], places_ned_m[rx])
            reach[tx].sort(key=lambda arrival: arrival.delay_ns)
        self.sources = StandingSources.of(radio, places_ned_m)
        """For carrier sense; the noise of links has those that pause as well, as if they were on all the time."""
        self._reach = {tx: FrameArrivals.of(arrivals, self._alone) for tx, arrivals in reach.items()}
        self._reached = {tx: tuple(rx for rx, _, _ in arrivals) for tx, arrivals in reach.items()}
        self._per = lru_cache(maxsize=65_536)(self._per_of)
        self._at_rate = lru_cache(maxsize=None)(radio.at_bit_rate)
        self._chances = lru_cache(maxsize=4_096)(self._chances_of)

    def _join(self, link: tuple[int, int], tx: Sequence[float], rx: Sequence[float]) -> list[Arrival]:
        """What arrives of a transmitter at a receiver, if anything."""
        path = self._radio.path(position_tx_ned_m=tx, position_rx_ned_m=rx)
        power_dbm = float(self._radio.mean_power_dbm(path))
        noise_dbm = float(self._radio.noise_dbm(path))
        is_heard = power_dbm >= noise_dbm + HEARD_DB and bool(
            self._radio.in_range(np.asarray(path.distance_m))
        )
        self._noise_mw[link] = float(ratio_from_db(noise_dbm))
        delay_ns = int(float(path.distance_m) / SPEED_OF_LIGHT_MPS * NS_PER_S + 0.5)
        self.longest_delay_ns = max(self.longest_delay_ns, delay_ns)
        return [Arrival(link[1], float(ratio_from_db(power_dbm)), delay_ns)] if is_heard else []

    @property
    def noise_mw(self) -> float:
        """Of the quietest receiver: what is weaker locks none."""
        return min(self._noise_mw.values())

    def reach(self, frame: AirFrame) -> Sequence[Arrival]:
        """All that its mean power reaches, unless it is far below the noise there."""
        return self._reach[frame.node]

    def survives(
        self, frame: AirFrame, receiver: int, power_mw: float, pieces: Sequence[Piece]
    ) -> tuple[bool, bool]:
        """By one draw for both: who comes through with interference does so without."""
        link = (frame.node, receiver)
        noise_mw = self._noise_mw[link]
        drawn = self._draws.uniform(*link, frame.number)
        rate_bps = frame.bit_rate_bps
        alone = self._kept * (1.0 - self._per(rate_bps, power_mw / noise_mw, frame.length_bytes))
        if len(pieces) == 1 and not pieces[0].interference_mw:
            return drawn < alone, drawn < alone
        duration_ns = frame.ended_ns - frame.started_ns
        together = self._kept
        for piece_ns, interference_mw in pieces:
            sinr = power_mw / (noise_mw + interference_mw)
            together *= 1.0 - self._per(rate_bps, sinr, frame.length_bytes * piece_ns / duration_ns)
        return drawn < together, drawn < alone

    def comes_alone(self, frame: AirFrame, receiver: int, power_mw: float) -> bool:
        """By the same draw."""
        return self.survives(frame, receiver, power_mw, [Piece(frame.ended_ns - frame.started_ns, 0.0)])[1]

    def _alone(self, frame: AirFrame, rows: Rows) -> NDArray[np.bool_]:
        receivers, chances = self._chances(frame.node, frame.length_bytes, frame.bit_rate_bps)
        came: NDArray[np.bool_] = (
            self._draws.uniforms(frame.node, receivers, frame.number)[rows] < chances[rows]
        )
        return came

    def _chances_of(
        self, tx: int, length_bytes: int, bit_rate_bps: float | None
    ) -> tuple[Sequence[int], FloatArray]:
        """Whom a transmitter reaches, and with which chance a frame that is alone comes through there."""
        reach = self._reach[tx].rows
        chances = [
            self._kept * (1.0 - self._per(bit_rate_bps, power_mw / self._noise_mw[tx, rx], length_bytes))
            for rx, power_mw, _ in reach
        ]
        return self._reached[tx], np.array(chances)

    def _per_of(self, bit_rate_bps: float | None, snr: float, length_bytes: float) -> float:
        return float(self._at_rate(bit_rate_bps).per_unchecked(db_from_ratio(snr), length_bytes))
