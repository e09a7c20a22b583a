"""What became of packets, as columns: fates that came one by one, and those of frames that passed many at once."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from channel.access.packets import AirFate, AirFates, AirPacket, Loss
from channel.access.world import Rows
from channel.checks import FloatArray
from channel.medium.reception import DELIVERED, ERASED, FATES, Fate
from channel.network.link_world import LinkWorld

OF_LOSS: Final[dict[Loss, int]] = {
    loss: FATES.index(Fate.TOO_LONG_FOR_A_SLOT if loss is Loss.TOO_LONG else Fate(loss.value))
    for loss in Loss
    if loss is not Loss.NOISE
}
"""What the record calls a loss; noise is what the channel says."""
INTERFERED: Final = FATES.index(Fate.INTERFERED)
NOTHING: Final = (float("nan"),) * 5

Ints = NDArray[np.int64]


class FateColumns(NamedTuple):
    """R fates.

    Attributes:
        packets: that they are of; the same one may come more than once.
        packet: place of each fate's in these, shape (R,).
        receiver: the node.
        at_ns: when it arrived, or was lost for good.
        started_ns, ended_ns: the transmission that decided; -1 if it never was on the air.
        attempts: how often it was on the air.
        figures: distance, power, SNR, error rate and chance of delivery on the channel alone, shape (R, 5).
        code: index into FATES.
    """

    packets: Sequence[AirPacket]
    packet: Rows
    receiver: Rows
    at_ns: Ints
    started_ns: Ints
    ended_ns: Ints
    attempts: NDArray[np.int32]
    figures: FloatArray
    code: NDArray[np.uint8]

    @classmethod
    def of(cls, fates: Sequence[AirFate], together: Sequence[AirFates], world: LinkWorld) -> FateColumns:
        """All of them, one by one first."""
        one_by_one, passed = _one_by_one(fates, world), _passed(together, world)
        if not passed.packets or not one_by_one.packets:
            return passed if passed.packets else one_by_one
        return cls(
            [*one_by_one.packets, *passed.packets],
            np.concatenate((one_by_one.packet, passed.packet + len(one_by_one.packets))),
            np.concatenate((one_by_one.receiver, passed.receiver)),
            np.concatenate((one_by_one.at_ns, passed.at_ns)),
            np.concatenate((one_by_one.started_ns, passed.started_ns)),
            np.concatenate((one_by_one.ended_ns, passed.ended_ns)),
            np.concatenate((one_by_one.attempts, passed.attempts)),
            np.concatenate((one_by_one.figures, passed.figures)),
            np.concatenate((one_by_one.code, passed.code)),
        )

    def at(self, rows: Rows) -> FateColumns:
        """Some of them."""
        return FateColumns(
            self.packets,
            self.packet[rows],
            self.receiver[rows],
            self.at_ns[rows],
            self.started_ns[rows],
            self.ended_ns[rows],
            self.attempts[rows],
            self.figures[rows],
            self.code[rows],
        )


def cause_of(fate: AirFate, world: LinkWorld) -> Fate:
    """The record's word for what became of a packet whose frames met this world."""
    return FATES[_code(fate, world)]


def _one_by_one(fates: Sequence[AirFate], world: LinkWorld) -> FateColumns:
    return FateColumns(
        [fate.packet for fate in fates],
        np.arange(len(fates)),
        np.array([fate.receiver for fate in fates], dtype=np.intp),
        np.array([fate.at_ns for fate in fates], dtype=np.int64),
        np.array([fate.started_ns for fate in fates], dtype=np.int64),
        np.array([fate.ended_ns for fate in fates], dtype=np.int64),
        np.array([fate.attempts for fate in fates], dtype=np.int32),
        np.array([_figures(fate, world) for fate in fates]).reshape(-1, 5),
        np.array([_code(fate, world) for fate in fates], dtype=np.uint8),
    )


def _passed(fates: Sequence[AirFates], world: LinkWorld) -> FateColumns:
    if not fates:
        return _one_by_one((), world)
    counts = [each.receiver.size for each in fates]
    packet = np.repeat(np.arange(len(fates)), counts)
    return FateColumns(
        [each.packet for each in fates],
        packet,
        np.concatenate([each.receiver for each in fates]),
        np.concatenate([each.at_ns for each in fates]),
        np.array([each.frame.started_ns for each in fates], dtype=np.int64)[packet],
        np.array([each.frame.ended_ns for each in fates], dtype=np.int64)[packet],
        np.ones(packet.size, dtype=np.int32),
        np.concatenate([world.figures_at(each.frame, each.receiver) for each in fates]),
        np.concatenate([_codes(each, world) for each in fates]),
    )


def _figures(fate: AirFate, world: LinkWorld) -> Sequence[float]:
    return NOTHING if fate.frame is None else world.figures(fate.frame, _met_at(fate))


def _met_at(fate: AirFate) -> int:
    return fate.receiver if fate.met_at is None else fate.met_at


def _code(fate: AirFate, world: LinkWorld) -> int:
    """What the record calls it; a frame that is lost to noise is lost as the channel says, or went unnoticed."""
    loss, frame = fate.loss, fate.frame
    if loss is None:
        return DELIVERED
    if loss is not Loss.NOISE or frame is None:
        return OF_LOSS.get(loss, ERASED)
    if _met_at(fate) in world.lost_to_sources(frame):
        return INTERFERED
    alone = world.fate(frame, _met_at(fate))
    return ERASED if alone == DELIVERED else alone


def _codes(fates: AirFates, world: LinkWorld) -> NDArray[np.uint8]:
    """As `_code`, of one frame."""
    codes = world.fates_at(fates.frame, fates.receiver)
    codes[codes == DELIVERED] = ERASED
    to_sources = world.lost_to_sources(fates.frame)
    if to_sources:
        codes[np.isin(fates.receiver, list(to_sources))] = INTERFERED
    codes[fates.came] = DELIVERED
    return codes
