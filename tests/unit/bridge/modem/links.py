"""Pairs of modems in a plain world, and what was on the air."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

from bridge.modem.heard import RadioMeter
from bridge.modem.modem import HostBytes
from bridge.modem.pair import ENDS, ModemPair
from bridge.modem.radio_status import SikStatus
from bridge.modem.settings import ModemSettings
from channel.access.media.sik.medium import Sik
from channel.access.media.sik.timing import SikSettings
from channel.access.packets import AirFate, AirFrame
from channel.access.world import PlainWorld
from channel.medium.reception import FATES, Fate
from channel.network.fates import ERASED, OF_LOSS

S = 1_000_000_000
MS = 1_000_000
SIK_AROUND_BYTES = 9
"""Of a frame without ECC, beside data, that errors can hit: sync 2, NETID 2, length 1, trailer 2, CRC 2."""


class RecordingWorld(PlainWorld):
    """A plain world that keeps what was on the air, and whether it came."""

    def __init__(self, **settings: Any) -> None:
        super().__init__([0, 1], **settings)
        self.frames: list[AirFrame] = []
        self.came: dict[tuple[int, int], bool] = {}

    def reach(self, frame: AirFrame) -> Any:
        self.frames.append(frame)
        self.came[frame.node, frame.number] = False
        return super().reach(frame)

    def survives(self, frame: AirFrame, *arguments: Any) -> tuple[bool, bool]:
        fate = super().survives(frame, *arguments)
        self.came[frame.node, frame.number] = fate[0]
        return fate

    def data(self, node: int) -> list[tuple[int, int, bool]]:
        """Frames with data of a SiK radio: when they ended, their data's length, and whether they came."""
        return [
            (frame.ended_ns, frame.length_bytes - SIK_AROUND_BYTES, self.came[frame.node, frame.number])
            for frame in self.frames
            if frame.node == node and frame.kind == "data"
        ]


def plain_cause(fate: AirFate) -> Fate:
    """The record's word in a world that tells no causes: noise is an erasure."""
    assert fate.loss is not None
    return FATES[OF_LOSS.get(fate.loss, ERASED)]


def sik_pair(world: RecordingWorld | PlainWorld, *, baud: int = 57_600, **settings: Any) -> ModemPair:
    """SiK modems in a plain world."""
    medium = Sik(world, SikSettings(**settings), seed=5)
    modem = ModemSettings(baud, 1850, 645, status=SikStatus() if medium.settings.framing else None)
    return ModemPair(medium, dict.fromkeys(ENDS, modem), {end: RadioMeter() for end in ENDS}, plain_cause)


def live(
    pair: ModemPair, until_ns: int, said: Sequence[tuple[int, int, bytes]] = (), step_ns: int = 50 * MS
) -> dict[int, list[HostBytes]]:
    """Say (instant, end, bytes) and live; what came out at each end."""
    out: dict[int, list[HostBytes]] = {end: [] for end in ENDS}
    instants = sorted({0, until_ns, *range(0, until_ns, step_ns), *(at_ns for at_ns, _, _ in said)})
    waiting = sorted(said, key=lambda each: each[0])
    for now_ns, next_ns in pairwise([*instants, until_ns + 1]):
        while waiting and waiting[0][0] <= now_ns:
            at_ns, end, data = waiting.pop(0)
            pair.receive(end, data, at_ns)
        for end, each in pair.advance(min(next_ns - 1, until_ns)):
            out[end].append(each)
    return out
