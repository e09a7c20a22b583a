"""Where the channels of a medium lie about the carrier of its radio."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Carriers:
    """Channels that are evenly spaced.

    Attributes:
        spacing_hz: between two channels that follow each other.
        channels: numbers of all on which anybody transmits or listens.
        middle: the number that would lie on the radio's carrier.
    """

    spacing_hz: float = 0.0
    channels: tuple[int, ...] = (0,)
    middle: float = 0.0

    @classmethod
    def centred(cls, count: int, spacing_hz: float) -> Carriers:
        """So many channels from 0 on, as many above the radio's carrier as below it: those of a radio that hops."""
        return cls(spacing_hz, tuple(range(count)), (count - 1) / 2)

    def offset_hz(self, channel: int) -> float:
        """Of a channel from the radio's carrier."""
        return (channel - self.middle) * self.spacing_hz
