"""How far a radio reaches: where its probability of delivery falls below a share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from channel.access.settings.base import Ideal
from channel.access.settings.medium import up_share_of
from channel.checks import FloatArray
from channel.link.radio import Radio
from channel.validity import OutsideValidityError

SHARES = (0.9, 0.5, 0.1)
HALF = 0.5
NEAREST_M, FARTHEST_M = 1.0, 1e6
POINTS, BETWEEN = 120, 60


@dataclass(frozen=True, slots=True)
class PreambleReach:
    """How far receivers lock on, where that is less far than error rates alone would let packets get.

    Attributes:
        level_dbm: the weakest signal that they lock on to.
        distance_m: to where the mean power is as strong; None: nowhere.
        erasure_m: to where half of the packets would arrive if they locked on to everything.
    """

    level_dbm: float
    distance_m: float | None
    erasure_m: float


@dataclass(frozen=True, slots=True)
class Reach:
    """How far packets of a length get, at equal heights.

    Attributes:
        payload_bytes: their length.
        height_m: of both ends above the ground.
        distance_m: by share of packets delivered; None if it is nowhere so high.
        limit_m: as far as the model says anything; None if no share was looked for, as the place decides or the model
            refuses short distances.
        preamble: if it is not the error rate that ends it; else None.
    """

    payload_bytes: int
    height_m: float
    distance_m: dict[str, float | None]
    limit_m: float | None
    preamble: PreambleReach | None = None


def reach_of(radio: Radio, payload_bytes: int) -> Reach:
    """The reach of a radio; of one whose law asks for places only that it does."""
    height_m = radio.config.default_height_m
    if radio.config.propagation.needs_places:
        return Reach(payload_bytes, height_m, {}, None)
    limit_m = FARTHEST_M
    while limit_m > NEAREST_M:
        distances = np.geomspace(NEAREST_M, limit_m, POINTS)
        try:
            chances = _chances(radio, distances, payload_bytes)
        except OutsideValidityError:
            limit_m /= 1.25
            continue
        found = {share: _farthest(radio, payload_bytes, share, distances, chances) for share in SHARES}
        shares = {f"{share:g}": distance_m for share, distance_m in found.items()}
        return Reach(payload_bytes, height_m, shares, limit_m, _preamble(radio, payload_bytes, distances))
    return Reach(payload_bytes, height_m, {}, None)


def _chances(radio: Radio, distances: FloatArray, payload_bytes: int) -> FloatArray:
    """The probability of delivery, with the outages of both ends' lines where the medium has some."""
    return up_share_of(radio.config.medium) * radio.probability_of_delivery(distances, payload_bytes)


def _preamble(radio: Radio, payload_bytes: int, distances: FloatArray) -> PreambleReach | None:
    """How far receivers lock on; None if packets are lost to noise before."""
    if not radio.needs_preamble:
        return None
    all_heard = Radio(radio.config.model_copy(update={"medium": Ideal()}))
    chances = _chances(all_heard, distances, payload_bytes)
    erasure_m = _farthest(all_heard, payload_bytes, HALF, distances, chances)
    locked = np.flatnonzero(radio.locks_on(radio.mean_power_dbm(radio.path(distances))))
    if erasure_m is None:
        return None
    distance_m = None
    if len(locked):
        near_m, far_m = distances[locked[-1]], distances[min(locked[-1] + 1, len(distances) - 1)]
        between = np.linspace(near_m, far_m, BETWEEN)
        heard = np.flatnonzero(radio.locks_on(radio.mean_power_dbm(radio.path(between))))
        distance_m = float(f"{between[heard[-1]]:.3g}")
    if distance_m is not None and distance_m >= erasure_m:
        return None
    return PreambleReach(radio.locks_from_dbm, distance_m, erasure_m)


def _farthest(
    radio: Radio, payload_bytes: int, share: float, distances: FloatArray, chances: FloatArray
) -> float | None:
    """The farthest distance with at least that share, to three digits; None if there is none."""
    above = np.flatnonzero(chances >= share)
    if not len(above):
        return None
    near_m, far_m = distances[above[-1]], distances[min(above[-1] + 1, len(distances) - 1)]
    between = np.linspace(near_m, far_m, BETWEEN)
    above = np.flatnonzero(_chances(radio, between, payload_bytes) >= share)
    return float(f"{between[above[-1]] if len(above) else near_m:.3g}")
