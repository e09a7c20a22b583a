"""What the supervisor hears of a run while it goes on, whatever carries it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from bridge.bus.keys import Keys
from bridge.fleet.glance import Glance

Take = Callable[[bytes], object]


class Tidings(Protocol):
    """Who is told; each payload is the message of that key."""

    glance: Glance | None
    """Given states and link reports; None: nobody looks at them."""

    def clock(self, payload: bytes) -> None:
        """A tick."""

    def pace(self, payload: bytes) -> None:
        """An operator holds the clock, or lets it go."""

    def end(self, payload: bytes) -> None:
        """The last tick is closed."""

    def ending(self, payload: bytes) -> None:
        """How far the record is."""

    def agent(self, node: str, payload: bytes) -> None:
        """What an agent says of itself."""

    def lost(self, text: str) -> None:
        """A part cannot go on, and with it the run."""


@dataclass(frozen=True, slots=True)
class SampleSorter:
    """Hands samples out by their keys."""

    keys: Keys
    to: Tidings

    def take(self, key: str, payload: bytes) -> None:
        """Hand one out; others than the supervisor's are passed over."""
        keys, to = self.keys, self.to
        whole: dict[str, Take] = {
            keys.clock: to.clock,
            keys.clock_pace: to.pace,
            keys.clock_end: to.end,
            keys.ending: to.ending,
        }
        if key in whole:
            whole[key](payload)
        elif key.endswith("/agent"):
            to.agent(keys.node_of(key), payload)
        elif to.glance is not None and key.endswith("/state"):
            to.glance.state_came(key, payload)
        elif to.glance is not None and key == keys.tick("links"):
            to.glance.links_came(payload)
