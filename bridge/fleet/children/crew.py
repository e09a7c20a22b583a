"""The child processes of a run: what has been started, and what it means that one ends."""

from __future__ import annotations

from collections.abc import Callable

from bridge.fleet.children.child import Child, ProcessSpec
from bridge.fleet.course import FleetError

TALKERS = ("router", "physics", "autopilot", "host", "fleet")
"""Processes whose logs may say why time stands still, by the beginnings of their names."""


class Crew:
    """Starts processes and keeps them in their order.

    Args:
        on_ended: called with each that ends, asked or not.
    """

    def __init__(self, on_ended: Callable[[Child], object]) -> None:
        self._on_ended = on_ended
        self.children: list[Child] = []

    def start(self, spec: ProcessSpec) -> Child:
        """Start one.

        Raises:
            FleetError: it cannot be started.
        """
        try:
            child = Child(spec)
        except OSError as error:
            raise FleetError(f"{spec.name} could not be started: {error}") from error
        self.children.append(child)
        child.ended.add_done_callback(lambda _: self._on_ended(child))
        return child

    def tails(self) -> str:
        """The last line of each log that may say why time stands still."""
        told = [child for child in self.children if child.spec.name.startswith(TALKERS)]
        return "\n".join(f"{child.spec.log_path}: {child.log_tail(1)}" for child in told)
