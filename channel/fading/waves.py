"""Sums of waves over the places of both ends and time, in whole-number phases.

A phase is a 32-bit number of 2^-32 turns: sums and products wrap around by themselves, exactly, on every machine.
Places count in steps of 2^-14 m (0.06 mm), time in steps of 2^14 ns (16 us). Cosines come from a table of 4096 phases,
rounded to 2^-24, so that sums of them are exact in any order.

The waves are common to all links of a run; what makes links differ are the phases of the waves, which a word of the
link gives: the phase of wave n is half of the word times a random odd number c_n.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from channel.checks import FloatArray
from channel.draws import Draws, uniform_from_words
from channel.fading.link_words import LinkWords, Words

Phases = NDArray[np.uint32]
PLACE_STEPS_PER_M = 2.0**14
TIME_SHIFT = 14
TIME_STEP_S = 2.0**TIME_SHIFT * 1e-9
TURN = 2.0**32
TABLE_BITS = 12
_TABLE_SHIFT = np.uint32(32 - TABLE_BITS)
_ANGLES = 2.0 * math.pi * np.arange(2**TABLE_BITS) / 2**TABLE_BITS
COSINE: FloatArray = np.rint(np.cos(_ANGLES) * 2.0**24) / 2.0**24
PHASOR: NDArray[np.complex128] = COSINE + 1j * np.rint(np.sin(_ANGLES) * 2.0**24) / 2.0**24
COARSE: FloatArray = np.rint(np.cos(_ANGLES) * 2.0**22) / 2.0**22
"""To 2^-22, so that sums of products of two are exact, too."""
LINKS_AT_ONCE = 1280
"""Keeps the phases of many waves in the processor's cache; changes no result."""


BY_PLACE = slice(0, 7)
"""Rows of `LinkPlaces` for a field over both places: three and three coordinates, and a word."""
BY_PLACE_AND_TIME = (0, 1, 2, 3, 4, 5, 7, 8)
"""Rows for a field over both places and time: the coordinates, the time and another word."""


class LinkPlaces(NamedTuple):
    """Where and when links are, in whole steps; the first end is the first by name, whoever transmits.

    Attributes:
        word: of the pair, shape (L,).
        rows: shape (9, L): place of the pair's first end, place of the other, half of the word, time, the other half.
    """

    word: Words
    rows: Phases


def link_places(
    words: LinkWords,
    tx: NDArray[np.intp],
    rx: NDArray[np.intp],
    tx_ned_m: FloatArray,
    rx_ned_m: FloatArray,
    sim_time_ns: NDArray[np.int64] | int,
) -> LinkPlaces:
    """Return links as the fields over places take them.

    Args:
        words: of the run's nodes.
        tx: index of each link's transmitter, shape (L,).
        rx: of its receiver.
        tx_ned_m: places, shape (L, 3) or (3,).
        rx_ned_m: likewise.
        sim_time_ns: shape (L,) or ().
    """
    first = words.tx_is_first(tx, rx)
    here, there = place_steps(tx_ned_m), place_steps(rx_ned_m)
    word = words.of_pair(tx, rx)
    rows = np.empty((9, len(tx)), dtype=np.uint32)
    for k in range(3):
        rows[k] = np.where(first, here[..., k], there[..., k])
        rows[k + 3] = np.where(first, there[..., k], here[..., k])
    rows[6] = word >> np.uint64(32)
    rows[7] = np.right_shift(sim_time_ns, TIME_SHIFT) & 0xFFFFFFFF
    rows[8] = word & np.uint64(0xFFFFFFFF)
    return LinkPlaces(word, rows)


def place_steps(place_ned_m: FloatArray) -> Phases:
    """Return places in metres as whole steps, modulo 2^32, same shape."""
    return np.rint(place_ned_m * PLACE_STEPS_PER_M).astype(np.int64).astype(np.uint32)


def wave_numbers(turns_per_m: ArrayLike) -> Phases:
    """Return waves in turns per metre as phases per step of place."""
    return _per_step(np.asarray(turns_per_m) / PLACE_STEPS_PER_M)


def frequencies(hertz: ArrayLike) -> Phases:
    """Return frequencies as phases per step of time."""
    return _per_step(np.asarray(hertz) * TIME_STEP_S)


def _per_step(turns: FloatArray) -> Phases:
    return np.rint(turns * TURN).astype(np.int64).astype(np.uint32)


def multipliers(draws: Draws, purpose: str, waves: int) -> Phases:
    """Return the random odd numbers that make phases of a word, shape (waves,)."""
    words = draws.words((purpose, "phases"), 0, waves)[:, 0]
    return (words >> np.uint64(32)).astype(np.uint32) | np.uint32(1)


def shifted_lattice(draws: Draws, purpose: str, points: int, dimensions: int) -> FloatArray:
    """Return a `lattice` with a random shift (Cranley & Patterson 1976): each point is uniform over the seeds."""
    words = draws.words((purpose, "shift"), 0, (dimensions + 3) // 4).ravel()[:dimensions]
    return lattice(points, dimensions, uniform_from_words(words))


def lattice(points: int, dimensions: int, shift: FloatArray | float = 0.5) -> FloatArray:
    """Return points spread evenly over the unit cube, shape (points, dimensions).

    The R sequence (Roberts 2018): powers of the inverse of the root of x^(d+1) = x + 1.
    """
    root = 2.0
    for _ in range(64):
        root = (1.0 + root) ** (1.0 / (dimensions + 1))
    ratios = np.power(root, -np.arange(1.0, dimensions + 1.0))
    return np.asarray((shift + np.arange(points)[:, np.newaxis] * ratios) % 1.0)


def phases(rows: Phases, waves: Phases) -> Phases:
    """Return the sum over k of waves[n, k] rows[k, l], shape (N, L), in whole turns modulo 1.

    Args:
        rows: of the links, shape (K, L).
        waves: shape (N, K).
    """
    return np.asarray(np.einsum("nk,kl->nl", waves, rows))


def cosine_sum(rows: Phases, waves: Phases) -> FloatArray:
    """Return the sum of the cosines of all waves at each link, shape (L,)."""
    out = np.empty(rows.shape[1])
    for part in _parts(rows.shape[1]):
        at = phases(rows[:, part], waves)
        at >>= _TABLE_SHIFT
        COSINE.take(at, mode="clip").sum(axis=0, out=out[part])
    return out


def product_sum(rows: Phases, waves: Phases, other_rows: Phases, other_waves: Phases) -> FloatArray:
    """Return the sum over all waves of the product of two cosines at each link, shape (L,)."""
    out = np.empty(rows.shape[1])
    for part in _parts(rows.shape[1]):
        one, other = phases(rows[:, part], waves), phases(other_rows[:, part], other_waves)
        one >>= _TABLE_SHIFT
        other >>= _TABLE_SHIFT
        product = COARSE.take(one, mode="clip")
        product *= COARSE.take(other, mode="clip")
        product.sum(axis=0, out=out[part])
    return out


def phasor_sum(rows: Phases, waves: Phases) -> NDArray[np.complex128]:
    """Return the sum of all waves at each link, each of amplitude 1, shape (L,)."""
    out = np.empty(rows.shape[1], dtype=np.complex128)
    for part in _parts(rows.shape[1]):
        at = phases(rows[:, part], waves)
        at >>= _TABLE_SHIFT
        PHASOR.take(at, mode="clip").sum(axis=0, out=out[part])
    return out


def phasor(turns: FloatArray) -> NDArray[np.complex128]:
    """Return exp(2 pi i turns) from the table, for turns from 0 on."""
    at = ((turns % 1.0) * 2.0**TABLE_BITS).astype(np.intp)
    return PHASOR.take(at, mode="clip")


def _parts(links: int) -> list[slice]:
    return [slice(start, start + LINKS_AT_ONCE) for start in range(0, links, LINKS_AT_ONCE)]
