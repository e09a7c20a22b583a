"""Packets one after the other, nobody waits for a turn: ``medium: {model: airtime}``."""

from __future__ import annotations

from typing import Literal

from channel.access.media.airtime import AirTime
from channel.access.media.medium import AccessMedium
from channel.access.settings.base import Serial, Surroundings


class AirTimeMedium(Serial):
    """Each node transmits as soon as its transmitter is free, without listening or acknowledgements."""

    model: Literal["airtime"] = "airtime"

    def open(self, surroundings: Surroundings) -> AccessMedium:
        """Make the medium."""
        hearing = self.hearing(surroundings)
        return AirTime(surroundings.world, self.timings(surroundings), self.queue.limits, hearing)
