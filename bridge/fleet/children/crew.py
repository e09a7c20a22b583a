"""The child processes of a run: what has been started, and what it means that one ends."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

from bridge.fleet.children.child import Child, ProcessSpec, Start, start_anew
from bridge.fleet.children.forked import Understudy
from bridge.fleet.course import FleetError

TALKERS = ("router", "physics", "autopilot", "host", "fleet")
"""Processes whose logs may say why time stands still, by the beginnings of their names."""


class Crew:
    """Starts processes and keeps them in their order.

    Args:
        on_ended: called with each that ends, asked or not.
        understudies: of processes of the run, by their names (`bridge.fleet.understudies`).
    """

    def __init__(
        self,
        on_ended: Callable[[Child], object],
        understudies: Mapping[str, Understudy] = MappingProxyType({}),
    ) -> None:
        self._on_ended, self._understudies = on_ended, understudies
        self.children: list[Child] = []

    def dismiss(self) -> None:
        """Whoever waits for a part to play ends."""
        for understudy in self._understudies.values():
            understudy.dismiss()

    def start(self, spec: ProcessSpec) -> Child:
        """Start one: its understudy plays it, if there is one.

        Raises:
            FleetError: it cannot be started.
        """
        understudy = self._understudies.get(spec.name)
        start: Start = start_anew if understudy is None else understudy.begin
        try:
            child = Child(spec, start)
        except OSError as error:
            raise FleetError(f"{spec.name} could not be started: {error}") from error
        self.children.append(child)
        child.ended.add_done_callback(lambda _: self._on_ended(child))
        return child

    def tails(self) -> str:
        """What each log says that may say why time stands still, a line each."""
        told = [child for child in self.children if child.spec.name.startswith(TALKERS)]
        return "".join(
            f"\n{child.spec.log_path}: {words}" for child in told if (words := child.last_words(1))
        )
