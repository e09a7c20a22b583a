"""What the supervisor hears of a run while it goes on, whatever carries it."""

from __future__ import annotations

import logging
from collections.abc import Callable
from functools import partial
from typing import Any, Protocol, TypeVar

from bridge.bus.keys import Keys
from bridge.bus.messages import AgentStatus, Clock, DecodeError, Header, Message
from bridge.fleet.glance import Came, Glance, message_of

M = TypeVar("M", bound=Message)
log = logging.getLogger("supervisor")


class Tidings(Protocol):
    """Who is called."""

    glance: Glance | None
    """Given states and link reports; None: nobody looks at them."""

    def clock(self, clock: Clock) -> None:
        """A tick."""

    def pace(self, clock: Clock) -> None:
        """An operator holds the clock, or lets it go."""

    def end(self, header: Header) -> None:
        """The last tick is closed."""

    def ending(self, header: Header) -> None:
        """How far the record is."""

    def agent(self, node: str, status: AgentStatus) -> None:
        """What an agent says of itself."""

    def warning(self, header: Header) -> None:
        """What somebody must see while the run goes on."""

    def lost(self, text: str) -> None:
        """A part cannot go on, and with it the run."""


class SampleSorter:
    """Hands out by their keys what the parts of a run say. What cannot be handled is logged and counted.

    Args:
        keys: of the run.
        to: who is called.

    Attributes:
        failed: how many could not be handled.
    """

    def __init__(self, keys: Keys, to: Tidings) -> None:
        self._keys, self._to = keys, to
        self.failed = 0
        self._takers: dict[str, tuple[type[Message], Callable[[Any], object]]] = {
            keys.clock: (Clock, to.clock),
            keys.clock_pace: (Clock, to.pace),
            keys.clock_end: (Header, to.end),
            keys.ending: (Header, to.ending),
        }

    def take(self, key: str, came: Came) -> None:
        """Hand out a message, coded or not; others than the supervisor's are passed over."""
        glance = self._to.glance
        if key.endswith("/state"):
            if glance is not None:
                glance.state_came(key, came)
        elif key == self._keys.tick("links"):
            if glance is not None:
                glance.links_came(came)
        elif key.endswith("/agent"):
            self._tell(key, AgentStatus, partial(self._to.agent, self._keys.node_of(key)), came)
        elif key.endswith("/warning"):
            self._tell(key, Header, self._to.warning, came)
        elif key in self._takers:
            self._tell(key, *self._takers[key], came)

    def _tell(self, key: str, cls: type[M], taker: Callable[[M], object], came: Came) -> None:
        try:
            taker(message_of(came, cls))
        except DecodeError as error:
            self.failed += 1
            log.warning("%s: %s", key, error)
        except Exception:
            self.failed += 1
            log.exception("%s", key)
