"""How strongly the random terms of two packets on one link are correlated under a radio's law.

Sources: shadowing and line of sight by Gudmundson (Electronics Letters 27 (1991)), exp(-(d_tx + d_rx) / d_corr);
surroundings that links share by Viterbi et al. (IEEE J. Sel. Areas Commun. 12 (1994)); scatter by Clarke and by Akki &
Haber (IEEE Trans. Veh. Technol. 35 (1986)), J0(2 pi d_tx / lambda) J0(2 pi d_rx / lambda) J0(2 pi f t), where waves
from the whole sphere have sin(x) / x for the first two. Nothing here is taken from the fields that draw the terms.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from channel.checks import FloatArray
from channel.config import RadioConfig
from channel.fading.blocks import CLARKE, coherence_octave, coherence_time_s
from channel.link.radio import Radio
from channel.medium.judge.heard import HeardPower, HeardPowers
from channel.numbers import special
from channel.numbers.units import SPEED_OF_LIGHT_MPS

LEAST_SPREAD = 1e-12
"""Of a change of the scattered field, below which rounding decides."""


class Correlations(NamedTuple):
    """Of the normal variables behind the terms of packets, shape (n,) each; of fading that of the scattered field."""

    shadowing: FloatArray
    sight: FloatArray
    fading: FloatArray


def correlations(look: HeardPower, others: HeardPowers) -> Correlations:
    """Return how the terms of a packet go together with those of others, of radios with the same law."""
    same = (others.link == look.link).astype(np.float64)
    sight, shadowing = look.radio.sight, look.radio.config.shadowing
    by_place = of_places(look, others, lasting_m(look.radio) or 1.0)
    if getattr(shadowing, "surroundings", "own") != "shared":
        ways_m = np.linalg.norm(others.ends_ned_m - look.ends_ned_m, axis=-1)
        by_place = np.exp(-ways_m.sum(axis=-1) / (lasting_m(look.radio) or 1.0)) * same
    return Correlations(
        _shadowing(look, others, by_place),
        np.zeros(len(same)) if sight is None else of_places(look, others, sight.decorrelation_m),
        _fading(look, others) * same,
    )


def of_places(look: HeardPower, others: HeardPowers, spacing_m: float) -> FloatArray:
    """Return the correlation of a field of both places that all pairs share, in both directions."""
    turned = look.ends_ned_m[::-1]
    both = [
        np.linalg.norm(others.ends_ned_m - ends, axis=-1).sum(axis=-1) for ends in (look.ends_ned_m, turned)
    ]
    near = [
        1.0 + np.exp(-2.0 * np.linalg.norm(ends[..., 0, :] - ends[..., 1, :], axis=-1) / spacing_m)
        for ends in (look.ends_ned_m, others.ends_ned_m)
    ]
    mirrored = np.exp(-both[0] / spacing_m) + np.exp(-both[1] / spacing_m)
    return np.asarray(mirrored / np.sqrt(near[0] * near[1]))


def lasting_m(radio: Radio) -> float:
    """Return how far the ends have to move for shadowing, or else the line of sight, to fall to 1/e; 0: no way."""
    if shadowing_lasts(radio):
        return float(radio.config.shadowing.decorrelation_m or 0.0)
    return 0.0 if radio.sight is None else radio.sight.decorrelation_m


def shadowing_lasts(radio: Radio) -> bool:
    """Return whether shadowing is a field over place."""
    shadowing = radio.config.shadowing
    return bool(shadowing.is_random and shadowing.decorrelation_m is not None)


def shared_ends(radio: Radio) -> float:
    """Return the correlation of two links with one end in common."""
    shadowing = radio.config.shadowing
    return float(getattr(shadowing, "shared_ends", 0.0)) if shadowing.is_random else 0.0


def _shadowing(look: HeardPower, others: HeardPowers, own: FloatArray) -> FloatArray:
    """Return the correlation of shadowing, with `own` as the part that is not shared with other links."""
    spacing_m, share = look.radio.config.shadowing.decorrelation_m, shared_ends(look.radio)
    if spacing_m is None or not look.radio.config.shadowing.is_random:
        return np.zeros(len(own))
    if not share:
        return own
    apart_m = np.linalg.norm(others.ends_ned_m[:, :, np.newaxis] - look.ends_ned_m, axis=-1)
    common = share * np.exp(-apart_m / spacing_m).sum(axis=(1, 2))
    variances = [
        1.0 + 2.0 * share * np.exp(-np.linalg.norm(ends[..., 0, :] - ends[..., 1, :], axis=-1) / spacing_m)
        for ends in (look.ends_ned_m, others.ends_ned_m)
    ]
    return np.asarray(((1.0 - 2.0 * share) * own + common) / np.sqrt(variances[0] * variances[1]))


def _fading(look: HeardPower, others: HeardPowers) -> FloatArray:
    config = look.radio.config
    fading = config.fading
    if not fading.is_random or fading.coherence == "packet":
        return np.zeros(len(others.link))
    if fading.coherence == "block":
        here, there = (
            _blocks(config, *each) for each in (_time(look), (others.sim_time_ns, others.speed_mps))
        )
        return np.asarray(np.all(here == there, axis=0), dtype=np.float64)
    lag_s = (others.sim_time_ns - look.sim_time_ns) * 1e-9
    return _of_scatter(config, np.asarray(lag_s), others.ends_ned_m - look.ends_ned_m)


def of_changes(config: RadioConfig, sim_time_ns: NDArray[np.int64], ends_ned_m: FloatArray) -> FloatArray:
    """Return the correlations of what the scattered field does within pairs of packets on one link, shape (n, n).

    Of the differences within two pairs, or of their sums, whichever go together more: the level that a change
    begins at counts, too.

    Args:
        config: of the link's radio.
        sim_time_ns: of both packets of each pair, shape (n, 2).
        ends_ned_m: where both ends were, shape (n, 2, 2, 3).
    """
    n = len(sim_time_ns)
    if not config.fading.is_random or config.fading.coherence != "doppler":
        return np.eye(n)
    when_s = np.asarray(sim_time_ns.reshape(-1) * 1e-9, dtype=np.float64)
    where = np.asarray(ends_ned_m.reshape(-1, 2, 3), dtype=np.float64)
    field = _of_scatter(config, when_s[:, np.newaxis] - when_s, where[:, np.newaxis] - where)
    first, second = slice(0, None, 2), slice(1, None, 2)
    crossed = field[first, second] + field[second, first]
    alike = field[first, first] + field[second, second]
    found = []
    for together in (alike - crossed, alike + crossed):
        spread = np.sqrt(np.maximum(np.diag(together), LEAST_SPREAD))
        found.append(np.abs(together) / np.outer(spread, spread))
    return np.asarray(np.minimum(np.maximum(*found), 1.0))


def _of_scatter(config: RadioConfig, lag_s: FloatArray, ways_m: FloatArray) -> FloatArray:
    """Return the autocorrelation of the scattered field over times (...) and the ways of both ends (..., 2, 3)."""
    fading = config.fading
    per_m = 2.0 * math.pi * config.frequency_hz / SPEED_OF_LIGHT_MPS
    still = special.j0(2.0 * math.pi * CLARKE / fading.max_coherence_s * lag_s)
    if getattr(fading, "scattering", "ring") == "sphere":
        by_end = np.sinc(per_m / math.pi * np.linalg.norm(ways_m, axis=-1))
    else:
        by_end = special.j0(per_m * np.linalg.norm(ways_m[..., :2], axis=-1))
    return np.asarray(still * by_end[..., 0] * by_end[..., 1])


def _time(look: HeardPower) -> tuple[NDArray[np.int64], FloatArray]:
    return np.array([look.sim_time_ns]), np.array([look.speed_mps])


def _blocks(config: RadioConfig, sim_time_ns: NDArray[np.int64], speed_mps: FloatArray) -> NDArray[np.int64]:
    """Return the blocks of time in which the fading holds, shape (2, n): see `channel.fading.blocks`."""
    octave = coherence_octave(coherence_time_s(speed_mps, config.frequency_hz, config.fading.max_coherence_s))
    return np.stack((octave, np.maximum(sim_time_ns, 0) >> octave))
