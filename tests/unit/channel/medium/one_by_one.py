"""Receptions one by one, for tests that look at single packets."""

import math
from typing import NamedTuple

from channel.medium.medium import FATES, Fate


class Got(NamedTuple):
    """One packet at one receiver, as a row of the columns."""

    sim_time_ns: int
    tx: str
    rx: str
    seq: int
    length_bytes: int
    distance_m: float
    received_power_dbm: float
    snr_db: float
    per: float
    fate: Fate
    probability_of_delivery: float


def rows(medium, receptions):
    """Each reception by itself, lengths as the error model counts them."""
    packets, packet = receptions.packets, receptions.packet
    columns = (
        packets.sim_time_ns[packet],
        [medium.nodes[i] for i in receptions.tx],
        [medium.nodes[i] for i in receptions.rx],
        packets.seq[packet],
        medium.counted_bytes(packets)[packet],
        receptions.distance_m,
        receptions.received_power_dbm,
        receptions.snr_db,
        receptions.per,
        [FATES[i] for i in receptions.fate],
        receptions.probability_of_delivery,
    )
    plain = (column if isinstance(column, list) else _numbers(column) for column in columns)
    return [Got(*row) for row in zip(*plain, strict=True)]


def _numbers(column):
    """A column as a list whose NaNs are one object, so that rows with it are equal."""
    return [math.nan if each != each else each for each in column.tolist()]


def settled(medium):
    """What a medium can settle by now."""
    return rows(medium, medium.settle())


def transmitted(medium, tx, seq, sim_time_ns, length_bytes):
    """Send one packet to everybody, or several of one instant, and settle what can be settled."""
    medium.send(medium.packets(tx=tx, seq=seq, sim_time_ns=sim_time_ns, length_bytes=length_bytes))
    return settled(medium)
