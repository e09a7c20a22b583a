"""Where a relay serves best, by the channel model; no I/O, no clock."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from channel import Radio

Floats = NDArray[np.float64]
Delivery = Callable[[Floats, Floats], Floats]
"""Probability of delivery from places to places: NED, m, shapes (..., 3), which are broadcast."""


class Links(NamedTuple):
    """The model of each direction: from the ground station to a UA, back, and from one UA to the other."""

    up: Delivery
    down: Delivery
    across: Delivery


class Chances(NamedTuple):
    """Probabilities that a packet gets from end to end, shape (...)."""

    up: Floats
    down: Floats

    @property
    def both(self) -> Floats:
        """That one gets up and another one down."""
        return self.up * self.down


def links_of(ground: Radio, ua: Radio, payload_bytes: int) -> Links:
    """The model of packets of a length between a ground station's radio and those of UA, which are alike."""
    return Links(
        delivery_of(ground, ua, payload_bytes),
        delivery_of(ua, ground, payload_bytes),
        delivery_of(ua, ua, payload_bytes),
    )


def delivery_of(transmitter: Radio, receiver: Radio, payload_bytes: int) -> Delivery:
    """Probability of delivery from one radio to another, averaged over what is random; aircraft fly level."""
    radio = transmitter.towards(receiver)

    def delivery(tx_ned_m: Floats, rx_ned_m: Floats) -> Floats:
        tx, rx = np.broadcast_arrays(tx_ned_m, rx_ned_m)
        places = {"position_tx_ned_m": tx.reshape(-1, 3), "position_rx_ned_m": rx.reshape(-1, 3)}
        return radio.expected_delivery(length_bytes=payload_bytes, **places).reshape(tx.shape[:-1])

    return delivery


def direct(links: Links, ground_ned_m: Floats, ua_ned_m: Floats) -> Chances:
    """Without a relay."""
    return Chances(links.up(ground_ned_m, ua_ned_m), links.down(ua_ned_m, ground_ned_m))


def relayed(links: Links, ground_ned_m: Floats, ua_ned_m: Floats, relay_ned_m: Floats) -> Chances:
    """With a relay that passes on what it hears, once: a packet arrives directly, or in two hops, or both ways.

    Hops are taken to be lost independently, given the places.
    """
    up, down = direct(links, ground_ned_m, ua_ned_m)
    return Chances(
        _either(up, links.up(ground_ned_m, relay_ned_m) * links.across(relay_ned_m, ua_ned_m)),
        _either(down, links.across(ua_ned_m, relay_ned_m) * links.down(relay_ned_m, ground_ned_m)),
    )


def _either(first: Floats, second: Floats) -> Floats:
    return 1.0 - (1.0 - first) * (1.0 - second)


def grid(north_m: ArrayLike, east_m: ArrayLike, cell_m: float, height_m: float) -> Floats:
    """Candidate places in a box at one height, shape (n, 3); ``north_m`` and ``east_m`` are [least, most]."""
    axes = [np.arange(low, high + 1e-6, cell_m) for low, high in (north_m, east_m)]
    north, east = np.meshgrid(*axes, indexing="ij")
    return np.stack([north, east, np.full_like(north, -height_m)], axis=-1).reshape(-1, 3)


def best(chances: Floats, candidates_ned_m: Floats, here_ned_m: Floats, slack: float) -> int:
    """Which candidate: of those within ``slack`` of the highest chance, the nearest to where the relay is.

    Near its top the chance is flat: a relay that always went for the very top would fly much for nothing.
    """
    away_m = np.linalg.norm(candidates_ned_m - here_ned_m, axis=-1)
    return int(np.argmin(np.where(chances >= np.max(chances) - slack, away_m, np.inf)))
