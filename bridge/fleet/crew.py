"""The child processes of a run: what has been started, and what it means that one ends."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

from bridge.fleet.child import Child, ProcessSpec
from bridge.fleet.course import FleetError

TALKERS = ("router", "physics", "autopilot", "host", "fleet")
"""Processes whose logs may tell why time stands still, by the beginnings of their names."""


class Crew:
    """Starts processes and keeps them in their order.

    Args:
        environment: of all of them.
        on_ended: told of each that ends, asked or not.
    """

    def __init__(self, environment: Mapping[str, str], on_ended: Callable[[Child], object]) -> None:
        self._environment, self._on_ended = environment, on_ended
        self.children: list[Child] = []

    async def start(self, spec: ProcessSpec) -> Child:
        """Start one.

        Raises:
            FleetError: it cannot be started.
        """
        try:
            child = await Child.start(replace(spec, environment=self._environment))
        except OSError as error:
            raise FleetError(f"{spec.name} could not be started: {error}") from error
        self.children.append(child)
        child.ended.add_done_callback(lambda _: self._on_ended(child))
        return child

    def tails(self) -> str:
        """The last line of each log that may tell why time stands still."""
        told = [child for child in self.children if child.spec.name.startswith(TALKERS)]
        return "\n".join(f"{child.spec.log_path}: {child.log_tail(1)}" for child in told)
