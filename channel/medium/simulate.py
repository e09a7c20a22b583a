"""Whole batches of packets at once: the same draws and the same fates as `medium`, for links at given distances."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from channel import checks
from channel.checks import ChannelInputError, FloatArray
from channel.draws import Draws, Purpose, uniform_from_words
from channel.fading.shadowing import standard_normal_from_uniform
from channel.link.decision import signal_of
from channel.link.radio import Radio
from channel.link.tables.lengths import Lengths

CHUNK_PACKETS = 16384
"""Packets worked on at once, so that they stay in the processor's cache; changes no result."""


@dataclass(frozen=True, slots=True)
class SimulatedFates:
    """Fates of packets, each array of shape (links, packets).

    Attributes:
        distance_m: between the ends, to 1 mm.
        received_power_dbm: with the drawn shadowing and fading, to 0.001 dB.
        snr_db: likewise.
        per: packet error rate at that SNR, to 1e-7; 1 out of range.
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
) -> SimulatedFates:
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
    if packets < 0:
        raise ChannelInputError("packets", packets, ">= 0")
    shape = (len(links), packets)
    if distance.shape not in ((), (1,), (packets,), (1, 1), (1, packets), (len(links), 1), shape):
        raise ChannelInputError(
            "distance_m", f"array of shape {distance.shape}", f"a number, shape {(len(links), 1)} or {shape}"
        )
    distance = np.broadcast_to(distance, np.broadcast_shapes(distance.shape, (len(links), 1)))
    payload = radio.config.nominal_payload_bytes if length_bytes is None else length_bytes
    length = Lengths.same(radio.length_bytes(payload))
    heard = np.empty((4, *shape))  # one piece of memory: the system hands out large ones in large pages
    delivered = np.empty(shape, dtype=bool)
    path = radio.path(distance, frequency_hz=frequency_hz)
    mean, noise = radio.mean_power_dbm(path), np.broadcast_to(radio.noise_dbm(path), distance.shape)
    elevation = path.elevation_deg
    step = max(1, CHUNK_PACKETS // max(packets, 1))
    purposes = _purposes(radio)
    for start in range(0, len(links), step):
        part = slice(start, min(start + step, len(links)))
        uniform = _uniforms(draws, links[part], purposes, first_seq, packets)
        power = mean[part] + _gain_db(radio, elevation[part], uniform)
        signal = signal_of(radio, distance[part], power, noise[part], length)
        for row, values in zip(heard, signal, strict=True):
            row[part] = values
        np.greater(uniform[Purpose.ERASURE], signal.per, out=delivered[part])
        if radio.needs_preamble:
            delivered[part] &= radio.locks_on(signal.received_power_dbm)
    if radio.config.base_loss > 0.0:
        extra = _uniforms(draws, links, [Purpose.BASE_LOSS], first_seq, packets)
        delivered &= extra[Purpose.BASE_LOSS] > radio.config.base_loss
    return SimulatedFates(heard[0], heard[1], heard[2], heard[3], delivered)


def _purposes(radio: Radio) -> list[Purpose]:
    """Return what draws of the packet stream the radio needs."""
    shadowing = [Purpose.SHADOWING] if radio.config.shadowing.is_random else []
    fading = [Purpose.FADING_I, Purpose.FADING_Q] if radio.config.fading.is_random else []
    return [Purpose.ERASURE, *shadowing, *fading]


def _gain_db(
    radio: Radio, elevation_deg: FloatArray, uniform: Mapping[Purpose, FloatArray]
) -> FloatArray | float:
    """Return what shadowing and fading do to the power, shape (links, packets), dB."""
    config = radio.config
    gain_db: FloatArray | float = 0.0
    if config.shadowing.is_random:
        normal = standard_normal_from_uniform(uniform[Purpose.SHADOWING])
        gain_db = np.negative(config.shadowing.loss_db(normal))
    if config.fading.is_random:
        first, second = uniform[Purpose.FADING_I], uniform[Purpose.FADING_Q]
        gain_db = gain_db + config.fading.gain_db(first, second, elevation_deg)
    return gain_db


def _check(radio: Radio) -> None:
    config = radio.config
    pulsed = radio.interference_varies or any(
        0.0 < each.duty < 1.0 for each in config.interference.interferers
    )
    for name, by_time in (
        ("shadowing.model", config.shadowing.decorrelation_m is not None),
        ("fading.coherence", config.fading.is_random and config.fading.coherence != "packet"),
        ("propagation.line_of_sight", radio.sight is not None),
        ("bursts.model", config.bursts.mean_loss > 0.0),
        ("interference.interferers", pulsed),
    ):
        if by_time:
            raise ChannelInputError(
                name, config.name, "a model that neither time nor place changes: use Medium"
            )


def _uniforms(
    draws: Draws,
    links: Sequence[tuple[str, str]],
    purposes: Sequence[Purpose],
    first_seq: int,
    packets: int,
) -> dict[Purpose, FloatArray]:
    """Return the draws of one stream for its purposes, shape (links, packets) each."""
    words = np.empty((len(purposes), len(links), packets), dtype=np.uint64)
    for row, (tx, rx) in enumerate(links):
        of_link = draws.words((tx, rx, purposes[0].stream), first_seq, packets)
        for k, purpose in enumerate(purposes):
            words[k, row] = of_link[:, purpose.word]
    return {purpose: uniform_from_words(words[k]) for k, purpose in enumerate(purposes)}
