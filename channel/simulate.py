"""Whole batches of packets at once: the same draws and the same fates as `medium`, for links at given distances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from channel import checks
from channel.checks import ChannelInputError, FloatArray
from channel.erasure import WORDS_PER_COUNT, Draws, Purpose, uniform_from_words
from channel.geometry import Path
from channel.radio import Radio
from channel.shadowing import standard_normal_from_uniform

CHUNK_PACKETS = 8192
"""Packets worked on at once, so that they stay in the processor's cache; changes no result."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """Fates of packets, each array of shape (links, packets).

    Attributes:
        distance_m: between the ends.
        received_power_dbm: with the drawn shadowing and fading.
        snr_db: likewise.
        per: packet error rate at that SNR; 1 out of range.
        delivered: whether the packet arrived.
    """

    distance_m: FloatArray
    received_power_dbm: FloatArray
    snr_db: FloatArray
    per: FloatArray
    delivered: NDArray[np.bool_]


def simulate(
    radio: Radio,
    draws: Draws,
    links: Sequence[tuple[str, str]],
    distance_m: ArrayLike,
    *,
    packets: int,
    first_seq: int = 0,
    length_bytes: int | None = None,
    frequency_hz: float | None = None,
) -> Outcome:
    """Send `packets` packets on each link, standing at a distance, and return what becomes of each.

    Args:
        radio: with shadowing and fading that are drawn per packet, no bursts and no pulsed interferers.
        draws: of the run: sequence number s of a link has the fate that `Medium` gives it at that distance.
        links: transmitter and receiver of each link.
        distance_m: shape (links, 1) or (links, packets), or a number.
        packets: how many on each link.
        first_seq: sequence number of the first.
        length_bytes: payload; the radio's nominal length if not given.
        frequency_hz: another carrier than the radio's.

    Raises:
        ChannelInputError: a radio whose terms depend on time or place, or a value out of range.
    """
    _check(radio)
    distance = checks.finite("distance_m", distance_m, 0.0)
    shape = (len(links), packets)
    distance = np.broadcast_to(distance, np.broadcast_shapes(distance.shape, (len(links), 1)))
    payload = radio.config.nominal_payload_bytes if length_bytes is None else length_bytes
    length = radio.length_bytes(payload)
    power, snr, per = np.empty(shape), np.empty(shape), np.empty(shape)
    delivered = np.empty(shape, dtype=bool)
    step = max(1, CHUNK_PACKETS // max(packets, 1))
    for start in range(0, len(links), step):
        part = slice(start, start + step)
        path = radio.path(distance[part], frequency_hz=frequency_hz)
        words = _words(draws, links[part], "packet", first_seq, packets)
        power[part] = _power_dbm(radio, path, words)
        np.subtract(power[part], radio.noise_dbm(path), out=snr[part])
        per[part] = radio.per(snr[part], length)
        if np.isfinite(radio.max_range_m):
            per[part] = np.where(distance[part] <= radio.max_range_m, per[part], 1.0)
        np.greater(_uniform(words, Purpose.ERASURE), per[part], out=delivered[part])
    if radio.config.base_loss > 0.0:
        extra = _words(draws, links, "extra", first_seq, packets)
        delivered &= _uniform(extra, Purpose.BASE_LOSS) > radio.config.base_loss
    return Outcome(np.broadcast_to(distance, shape), power, snr, per, delivered)


def _power_dbm(radio: Radio, path: Path, words: NDArray[np.uint64]) -> FloatArray:
    """Return received power with shadowing and fading, shape (links, packets)."""
    config = radio.config
    power = radio.mean_power_dbm(path)
    if config.shadowing.is_random:
        power = power - config.shadowing.loss_db(
            standard_normal_from_uniform(_uniform(words, Purpose.SHADOWING))
        )
    if config.fading.is_random:
        first, second = _uniform(words, Purpose.FADING_I), _uniform(words, Purpose.FADING_Q)
        power = power + config.fading.gain_db(first, second, path.elevation_deg)
    return power


def _check(radio: Radio) -> None:
    config = radio.config
    pulsed = any(0.0 < each.duty < 1.0 for each in config.interference.interferers)
    for name, by_time in (
        ("shadowing.model", config.shadowing.decorrelation_m is not None),
        ("fading.coherence", config.fading.is_random and config.fading.coherence == "doppler"),
        ("bursts.model", config.bursts.mean_loss > 0.0),
        ("interference.interferers", pulsed),
    ):
        if by_time:
            raise ChannelInputError(
                name, config.name, "a model that neither time nor place changes: use Medium"
            )


def _words(
    draws: Draws, links: Sequence[tuple[str, str]], stream: str, first_seq: int, packets: int
) -> NDArray[np.uint64]:
    words = np.empty((len(links), packets, WORDS_PER_COUNT), dtype=np.uint64)
    for row, (tx, rx) in zip(words, links, strict=True):
        row[:] = draws.words((tx, rx, stream), first_seq, packets)
    return words


def _uniform(words: NDArray[np.uint64], purpose: Purpose) -> FloatArray:
    return uniform_from_words(words[:, :, purpose.word])
