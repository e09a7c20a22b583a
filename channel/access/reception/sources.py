"""Carrier sense of what is on the air and is no frame: interferers and emitters."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Final

from channel.access.agenda import SIGNAL_ENDS, SIGNAL_STARTS, Agenda, Entry
from channel.access.world import Sources

if TYPE_CHECKING:
    from channel.access.reception.receiver import Receiver

NOBODY: Final = -1


class SensedSources:
    """Tells receivers what they take in of sources, while their access attends to what they hear.

    Args:
        agenda: of the medium.
        sources: of its world.
        ignore: called with a receiver whose access has nothing left for which it would attend.
    """

    def __init__(self, agenda: Agenda, sources: Sources, ignore: Callable[[Receiver], object]) -> None:
        self._agenda, self._sources, self._ignore = agenda, sources, ignore
        self._listening: dict[int, Receiver] = {}
        self._next: Entry | None = None

    def follow(self, receiver: Receiver) -> None:
        """From now on, and with what is there already."""
        now_ns = self._agenda.now_ns
        self._listening[receiver.node] = receiver
        since_ns, _ = self._sources.span_ns(now_ns)
        [power_mw] = self._sources.powers_mw([receiver.node], now_ns)
        receiver.meets_sources(power_mw, since_ns)
        self._plan()

    def leave(self, receiver: Receiver) -> None:
        """From now on not any more."""
        if self._listening.pop(receiver.node, None) is not None:
            receiver.hears_sources(0.0)

    def _plan(self) -> None:
        if self._next is None and self._listening:
            _, until_ns = self._sources.span_ns(self._agenda.now_ns)
            self._next = self._agenda.at(until_ns, SIGNAL_ENDS, NOBODY, self._change)

    def _change(self) -> None:
        """Another span begins: who acts at its first instant hears what has ended, and not yet what begins."""
        self._next = None
        for receiver in [each for each in self._listening.values() if each.is_done()]:
            self._ignore(receiver)
        if not self._listening:
            return
        listening = sorted(self._listening.items())
        nodes = [node for node, _ in listening]
        powers_mw = dict(zip(nodes, self._sources.powers_mw(nodes, self._agenda.now_ns), strict=True))
        for node, receiver in listening:
            if powers_mw[node] < receiver.sources_mw:
                receiver.hears_sources(powers_mw[node])
        if any(powers_mw[node] > receiver.sources_mw for node, receiver in listening):
            self._agenda.at(self._agenda.now_ns, SIGNAL_STARTS, NOBODY, self._begin, powers_mw)
        self._plan()

    def _begin(self, powers_mw: Mapping[int, float]) -> None:
        for node, power_mw in powers_mw.items():
            receiver = self._listening.get(node)
            if receiver is not None and power_mw > receiver.sources_mw:
                receiver.hears_sources(power_mw)
