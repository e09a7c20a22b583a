"""The law of what shadowing, fading and the line of sight do to a received power: its distribution function."""

from __future__ import annotations

import numpy as np

from channel.checks import FloatArray
from channel.geometry import Path
from channel.link.radio import Radio

PANELS = 32
FINE_PANELS = 512
"""Of fading without shadowing, whose law is then a stair over the nodes."""
LEAST_SIGMA_DB = 1e-6
"""A sigma of 0 counts as this: a step."""


def chance_of_less(radio: Radio, path: Path, gain_db: FloatArray) -> FloatArray:
    """Return the probability that the random terms add less than a gain to the power of the link budget.

    Args:
        radio: the radio.
        path: the links, shape (L,) or (1,).
        gain_db: received power less that of the link budget, dB, shape (L,).

    Returns:
        Shape (L,): uniform over (0, 1), if the gains are drawn from the law.
    """
    fading = radio.config.fading
    elevation = path.elevation_deg if fading.by_elevation else np.zeros(1)
    panels = PANELS if radio.config.shadowing.is_random else FINE_PANELS
    nodes_db, weights = fading.rule(elevation, panels)
    out = np.zeros(len(gain_db))
    for chance, excess_db, sigma_db in _states(radio, path, len(gain_db)):
        # the loss has to be more than this for the gain to be less
        least_db = nodes_db - (gain_db + excess_db)[:, np.newaxis]
        out += chance * np.sum(weights * _chance_of_more(radio, least_db, sigma_db), axis=-1)
    return np.clip(out, 0.0, 1.0)


def _states(radio: Radio, path: Path, links: int) -> list[tuple[FloatArray, FloatArray, FloatArray]]:
    if radio.sight is not None:
        return [(state.chance, state.excess_db, state.sigma_db) for state in radio.sight.states(path)]
    sigma_db = radio.config.shadowing.spread_db
    return [(np.ones(links), np.zeros(links), np.full(links, sigma_db))]


def _chance_of_more(radio: Radio, loss_db: FloatArray, sigma_db: FloatArray) -> FloatArray:
    """Return the probability that shadowing costs more, shape (L, nodes)."""
    shadowing = radio.config.shadowing
    if not shadowing.is_random:
        return np.asarray(loss_db < 0.0, dtype=np.float64)
    scaled = loss_db / np.maximum(sigma_db, LEAST_SIGMA_DB)[:, np.newaxis]
    return 1.0 - shadowing.with_sigma(1.0).chance_below(scaled)
