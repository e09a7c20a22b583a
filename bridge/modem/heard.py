"""What radios measure of what they hear: powers, noise, errors. A world that looks on while a medium uses another."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from channel.access.packets import AirFrame
from channel.access.world import Arrival, Piece
from channel.network.link_world import LinkWorld
from channel.numbers.units import db_from_ratio

FRAMES_OF_QUALITY: Final = 100
"""ExpressLRS: link quality is the share of the last so many frames of its peer that a receiver heard."""
COUNTER_MAX: Final = 0xFFFF
STATISTICS: Final = "statistics"
"""The frames of a SiK radio that tell its peer what it measures."""


@dataclass(slots=True)
class RadioMeter:
    """What one radio has measured.

    Attributes:
        rssi, noise: averages as SiK's firmware has them, in its units (`register_of`): of frames that came, and of all
            that the radio takes in when it might transmit.
        remote: these two of the peer, as it said last.
        frames: that came through.
        errors: frames that it followed and took for ones with errors.
        power_dbm, snr_db: of the last frame that came.
        heard_ns: when that was; None: none came.
        quality: of the last frames of the peer, whether they came.
    """

    rssi: int = 0
    noise: int = 0
    remote: tuple[int, int] = (0, 0)
    frames: int = 0
    errors: int = 0
    power_dbm: float = float("nan")
    snr_db: float = float("nan")
    heard_ns: int | None = None
    quality: deque[bool] = field(default_factory=lambda: deque(maxlen=FRAMES_OF_QUALITY))

    def takes(self, power_dbm: float, snr_db: float, at_ns: int) -> None:
        """A frame came."""
        self.frames += 1
        self.power_dbm, self.snr_db, self.heard_ns = power_dbm, snr_db, at_ns
        self.rssi = (register_of(power_dbm) + 7 * self.rssi) // 8

    def samples(self, power_dbm: float) -> None:
        """It might transmit, and measures what it takes in."""
        self.noise = (register_of(power_dbm) + 3 * self.noise) // 4

    def heard_nobody(self) -> None:
        """It looks for its peers twice a second: none was heard, and the last frame's power counts once more."""
        last = 0 if self.heard_ns is None else register_of(self.power_dbm)
        self.rssi = (last + 3 * self.rssi) // 4


def register_of(power_dbm: float) -> int:
    """A power as the radio chip of SiK radios measures it: dBm = register / 1.9 - 127."""
    return min(max(round((power_dbm + 127.0) * 1.9), 0), 255)


class HeardWorld:
    """A world, and what its nodes' radios measure in it.

    Args:
        world: links as in a run.
        noise_dbm: of each node's receiver, while nothing is heard.
        peers: of each node those whose frames its radio takes; those of others the radio drops at their header.
        counts_foreign: whether others' frames are errors: with ECC the firmware of SiK finds their NETID, not the chip.
    """

    def __init__(
        self,
        world: LinkWorld,
        noise_dbm: Mapping[int, float],
        peers: Mapping[int, Collection[int]],
        *,
        counts_foreign: bool = False,
    ) -> None:
        self._world, self._peers, self._counts_foreign = world, peers, counts_foreign
        self.nodes, self.ids = world.nodes, world.ids
        self.heard = {node: RadioMeter(noise=register_of(noise_dbm[node])) for node in world.nodes}
        self.sources = world.sources
        self._came: dict[tuple[int, int], bool] = {}
        """Of a node and the sender of a frame that counts once the next begins: whether it came."""

    def reach(self, frame: AirFrame) -> Sequence[Arrival]:
        """As in the world; its peers take note of what became of the frame before."""
        for node, heard in self.heard.items():
            if frame.node in self._peers[node]:
                came = self._came.get((node, frame.node))
                if came is not None:
                    heard.quality.append(came)
                self._came[node, frame.node] = False
        return self._world.reach(frame)

    def survives(
        self, frame: AirFrame, receiver: int, power_mw: float, pieces: Sequence[Piece]
    ) -> tuple[bool, bool]:
        """As in the world; the receiver measures it, if it is a peer's."""
        fate = self._world.survives(frame, receiver, power_mw, pieces)
        heard = self.heard[receiver]
        is_foreign = frame.node not in self._peers[receiver]
        if is_foreign and not self._counts_foreign:
            return fate
        if fate[0] and not is_foreign:
            _, power_dbm, snr_db, *_ = self._world.figures(frame, receiver)
            heard.takes(power_dbm, snr_db, frame.ended_ns)
            self._came[receiver, frame.node] = True
            if frame.kind == STATISTICS:
                sender = self.heard[frame.node]
                heard.remote = (sender.rssi, sender.noise)
        else:
            heard.errors = min(heard.errors + 1, COUNTER_MAX)
        return fate

    def comes_alone(self, frame: AirFrame, receiver: int, power_mw: float) -> bool:
        """As in the world; the receiver measures nothing of what it does not follow."""
        return self._world.comes_alone(frame, receiver, power_mw)

    def is_off(self, node: int, at_ns: int) -> bool:
        """As in the world (`channel.access.world.Switched`)."""
        return self._world.is_off(node, at_ns)

    def are_apart(self, node: int, other: int, at_ns: int) -> bool:
        """As in the world (`channel.access.world.Parted`)."""
        return self._world.are_apart(node, other, at_ns)

    def samples_noise(self, node: int, at_ns: int, energy_mw: float) -> None:
        """A node's radio might transmit: it measures noise and signals (`channel.access.world.Metering`)."""
        taken_mw = self._world.noise_mw(node, at_ns) + energy_mw
        self.heard[node].samples(float(db_from_ratio(taken_mw)))

    def heard_nobody(self, node: int) -> None:
        """A node's radio has had no frame since it last looked."""
        self.heard[node].heard_nobody()
