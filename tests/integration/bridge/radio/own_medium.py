"""A medium of one's own, as docs/reference/air.md shows it: each packet waits a while before it goes on the air."""

from pydantic import Field

from channel.access.agenda import ACTS
from channel.access.media.medium import AccessMedium
from channel.access.media.plain import PlainMedium
from channel.access.settings.base import Serial, Surroundings


class Patient(PlainMedium):
    """Lets each packet wait, then transmits it."""

    wait_ns = 0

    def _wake(self, node: int) -> None:
        packet = self._next(node)  # takes it from the queue
        if packet is not None:
            self.agenda.at(
                self.agenda.now_ns + self.wait_ns, ACTS, node, self._transmit, packet, self._nothing
            )

    def _nothing(self) -> None:
        """After the end of a transmission nothing is to be done."""


class PatientMedium(Serial):
    """Its settings: the keys of a plain radio, and the wait."""

    wait_s: float = Field(default=0.01, ge=0.0)

    def open(self, surroundings: Surroundings) -> AccessMedium:
        """Make the medium."""
        timings, hearing = self.timings(surroundings), self.hearing(surroundings)
        medium = Patient(surroundings.world, timings, self.queue.limits, hearing)
        medium.wait_ns = round(self.wait_s * 1e9)
        return medium
