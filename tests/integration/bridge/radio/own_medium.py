"""A medium of one's own, as docs/reference/air.md shows it: each packet waits a while before it goes on the air."""

from functools import partial
from typing import Any

from pydantic import Field

from channel.access.agenda import ACTS
from channel.access.media.medium import AccessMedium
from channel.access.media.plain import PlainMedium
from channel.access.settings.base import Serial, Surroundings


class Patient(PlainMedium):
    """Lets each packet wait, then transmits it: one after the other, as a node has one transmitter."""

    wait_ns = 0

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._busy: set[int] = set()

    def _wake(self, node: int) -> None:  # called with each packet that enters the queue
        packet = None if node in self._busy else self._next(node)  # takes it from the queue
        if packet is not None:
            self._busy.add(node)
            at_ns, then = self.agenda.now_ns + self.wait_ns, partial(self._sent, node)
            self.agenda.at(at_ns, ACTS, node, self._transmit, packet, then)

    def _sent(self, node: int) -> None:
        """At the end of a frame; its transmitter is free for another when this has returned."""
        self._busy.remove(node)
        self.agenda.at(self.agenda.now_ns, ACTS, node, self._wake, node)


class PatientMedium(Serial):
    """Its settings: the keys of a plain radio, and the wait."""

    wait_s: float = Field(default=0.01, ge=0.0)

    def open(self, surroundings: Surroundings) -> AccessMedium:
        """Make the medium."""
        timings, hearing = self.timings(surroundings), self.hearing(surroundings)
        medium = Patient(surroundings.world, timings, self.queue.limits, hearing)
        medium.wait_ns = round(self.wait_s * 1e9)
        return medium
