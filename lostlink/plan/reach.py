"""How far a radio reaches: where its probability of delivery falls below a share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from channel.checks import FloatArray
from channel.link.radio import Radio
from channel.validity import OutsideValidityError

SHARES = (0.9, 0.5, 0.1)
NEAREST_M, FARTHEST_M = 1.0, 1e6
POINTS, BETWEEN = 120, 60


@dataclass(frozen=True, slots=True)
class Reach:
    """How far packets of a length get, at equal heights.

    Attributes:
        distance_m: by share of packets delivered; None if it is nowhere so high.
        limit_m: as far as the model says anything; None if no share was looked for, as the place decides or the model
            refuses short distances.
    """

    distance_m: dict[str, float | None]
    limit_m: float | None


def reach_of(radio: Radio, payload_bytes: int) -> Reach:
    """The reach of a radio; of one whose law asks for places only that it does."""
    if getattr(radio.config.propagation, "needs_places", False):
        return Reach({}, None)
    limit_m = FARTHEST_M
    while limit_m > NEAREST_M:
        distances = np.geomspace(NEAREST_M, limit_m, POINTS)
        try:
            chances = radio.probability_of_delivery(distances, payload_bytes)
        except OutsideValidityError:
            limit_m /= 1.25
            continue
        found = {share: _farthest(radio, payload_bytes, share, distances, chances) for share in SHARES}
        return Reach({f"{share:g}": distance_m for share, distance_m in found.items()}, limit_m)
    return Reach({}, None)


def _farthest(
    radio: Radio, payload_bytes: int, share: float, distances: FloatArray, chances: FloatArray
) -> float | None:
    """The farthest distance with at least that share, to three digits; None if there is none."""
    above = np.flatnonzero(chances >= share)
    if not len(above):
        return None
    near_m, far_m = distances[above[-1]], distances[min(above[-1] + 1, len(distances) - 1)]
    between = np.linspace(near_m, far_m, BETWEEN)
    above = np.flatnonzero(radio.probability_of_delivery(between, payload_bytes) >= share)
    return float(f"{between[above[-1]]:.3g}")
