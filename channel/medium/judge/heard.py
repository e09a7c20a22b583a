"""Received powers that the judge looks at: of one packet on one link each, with where and when it was."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from channel.checks import FloatArray
from channel.draws import WORDS_PER_COUNT, Draws, stream_key, uniform_from_words
from channel.geometry import Path
from channel.link.radio import Radio
from channel.link.tables.steps import STEPS_PER_DB
from channel.medium.links import Indices, LinksOfPass

CELL_DB = 0.5 / STEPS_PER_DB + 1e-9
"""A power that is written as p was between p - this and p + this; with a hair, for sums in doubles."""


class HeardPower(NamedTuple):
    """A packet on a link.

    Attributes:
        radio: of the link.
        link: its number among those judged.
        seq: sequence number of the packet.
        sim_time_ns: when it was sent.
        path: of one link.
        ends_ned_m: places of both ends, shape (2, 3).
        speed_mps: relative speed of the ends; 0 if no random term asks for it.
        mean_dbm: power of the link budget.
        power_dbm: as received, rounded.
    """

    radio: Radio
    link: int
    seq: int
    sim_time_ns: int
    path: Path
    ends_ned_m: FloatArray
    speed_mps: float
    mean_dbm: float
    power_dbm: float

    @property
    def gain_db(self) -> float:
        """What the random terms did to the power."""
        return self.power_dbm - self.mean_dbm

    def uniforms(self, draws: Draws, purpose: str, count: int) -> FloatArray:
        """Return so many random numbers of this look alone: not those that drew the packet."""
        key = stream_key(draws.seed, "judge", purpose, str(self.link), str(self.seq))
        words = draws.run(key, 0, -(-count // WORDS_PER_COUNT))
        return uniform_from_words(words).ravel()[:count]


class HeardPowers(NamedTuple):
    """Several looks at links of one kind, as columns, shape (n,) each; the ends (n, 2, 3)."""

    link: NDArray[np.int64]
    sim_time_ns: NDArray[np.int64]
    ends_ned_m: FloatArray
    speed_mps: FloatArray

    @classmethod
    def of(cls, looks: Sequence[HeardPower]) -> HeardPowers:
        """Return looks as columns."""
        return cls(
            np.array([look.link for look in looks], dtype=np.int64),
            np.array([look.sim_time_ns for look in looks], dtype=np.int64),
            np.array([look.ends_ned_m for look in looks]).reshape(-1, 2, 3),
            np.array([look.speed_mps for look in looks]),
        )

    def followed_by(self, look: HeardPower) -> HeardPowers:
        """Return these and one more, which as a look has its path beside it, and is much larger."""
        return HeardPowers._make(map(np.concatenate, zip(self, HeardPowers.of([look]), strict=True)))


def heard_power(
    radio: Radio, links: LinksOfPass, number: int, row: int, mean_dbm: float, dbm: float
) -> HeardPower:
    """Return one of the links of a pass.

    Args:
        radio: of the link.
        links: all of them.
        number: of the link among those judged.
        row: of the link.
        mean_dbm: its power by the link budget.
        dbm: as received.
    """
    one: Indices = np.array([row], dtype=np.intp)
    here = links.at(one)
    path, speed_mps = here.path, 0.0
    assert path.position_tx_ned_m is not None
    assert path.position_rx_ned_m is not None
    if here.velocity_tx_ned_mps is not None and here.velocity_rx_ned_mps is not None:
        speed_mps = float(np.linalg.norm(here.velocity_rx_ned_mps - here.velocity_tx_ned_mps))
    ends = np.concatenate((path.position_tx_ned_m, path.position_rx_ned_m))
    seq, when_ns = int(here.seq[0]), int(here.sim_time_ns[0])
    return HeardPower(radio, number, seq, when_ns, path, ends, speed_mps, mean_dbm, dbm)
