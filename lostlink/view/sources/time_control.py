"""How time goes on, for a viewer who may change it: a running simulation with `--control`, or a record."""

from __future__ import annotations

from typing import Protocol


class TimeControl(Protocol):
    """What the timeline does. Each may take its time; the view shows what came of it."""

    can_seek: bool
    """Whether any instant can be gone to: of a record, yes."""

    def pause(self) -> None:
        """Hold sim time."""

    def resume(self) -> None:
        """Let it go on."""

    def step(self) -> None:
        """One tick further, and hold."""

    def speed(self, factor: float) -> None:
        """Sim time per wall time; infinite: as fast as possible."""

    def seek(self, sim_time_s: float) -> None:
        """Go to an instant.

        Raises:
            ValueError: it cannot be done.
        """
