"""The child processes of a run: what has been started, and what it means that one ends."""

from __future__ import annotations

from collections.abc import Callable

from bridge.fleet.children.child import Child, ProcessSpec, Start, start_anew
from bridge.fleet.children.forked import Understudy
from bridge.fleet.course import FleetError

TALKERS = ("router", "physics", "autopilot", "host", "fleet")
"""Processes whose logs may say why time stands still, by the beginnings of their names."""


class Crew:
    """Starts processes and keeps them in their order.

    Args:
        on_ended: called with each that ends, asked or not.
        understudy: of the program of a run of one process, if there is one.
    """

    def __init__(self, on_ended: Callable[[Child], object], understudy: Understudy | None = None) -> None:
        self._on_ended, self._understudy = on_ended, understudy
        self.children: list[Child] = []

    def start_program(self, spec: ProcessSpec) -> Child:
        """Start the program of a run of one process: its understudy plays it, if there is one.

        Raises:
            FleetError: it cannot be started.
        """
        return self.start(spec, start_anew if self._understudy is None else self._understudy.begin)

    def dismiss(self) -> None:
        """Whoever waits for a part to play ends."""
        if self._understudy is not None:
            self._understudy.dismiss()

    def start(self, spec: ProcessSpec, start: Start = start_anew) -> Child:
        """Start one.

        Raises:
            FleetError: it cannot be started.
        """
        try:
            child = Child(spec, start)
        except OSError as error:
            raise FleetError(f"{spec.name} could not be started: {error}") from error
        self.children.append(child)
        child.ended.add_done_callback(lambda _: self._on_ended(child))
        return child

    def tails(self) -> str:
        """The last line of each log that may say why time stands still."""
        told = [child for child in self.children if child.spec.name.startswith(TALKERS)]
        return "\n".join(f"{child.spec.log_path}: {child.log_tail(1)}" for child in told)
