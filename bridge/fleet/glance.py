"""The newest of what a run publishes for people: kept as it comes, decoded only when somebody looks."""

from __future__ import annotations

from collections import deque
from typing import TypeVar

from bridge.bus.messages import AircraftState, DecodeError, Links, Message, decode

LINKS_KEPT = 6
"""Link reports come five times per second of sim time, or less often: the oldest kept is at least a second older."""
LATELY_NS = 1_000_000_000
M = TypeVar("M", bound=Message)
Came = bytes | Message
"""A message, coded or not."""


def message_of(came: Came, cls: type[M]) -> M:
    """What came, decoded if it has to be.

    Raises:
        DecodeError: it is no message of that kind.
    """
    message = decode(came, cls) if isinstance(came, bytes) else came
    assert isinstance(message, cls)
    return message


class Glance:
    """States of UA and link reports. What comes may come in any thread, and at any rate, at next to no cost.

    Attributes:
        malformed: payloads that were looked at and could not be decoded.
    """

    def __init__(self) -> None:
        self.malformed = 0
        self._states: dict[str, Came] = {}
        self._links: deque[Came] = deque(maxlen=LINKS_KEPT)

    def state_came(self, key: str, came: Came) -> None:
        """Keep the state of a UA."""
        self._states[key] = came

    def links_came(self, came: Came) -> None:
        """Keep a report on all links."""
        self._links.append(came)

    def states(self) -> dict[str, AircraftState]:
        """The newest state of each UA, by its id."""
        decoded = (self._decoded(payload, AircraftState) for payload in list(self._states.values()))
        return {state.header.frame_id: state for state in decoded if state is not None}

    def links(self) -> tuple[Links, Links]:
        """The newest report on all links, and the last one that is a second of sim time older, or else the oldest.

        Of a run that is faster than its reports that is longer ago.
        """
        kept = [links for each in list(self._links) if (links := self._decoded(each, Links)) is not None]
        if not kept:
            return Links(), Links()
        newest, *older = reversed(kept)
        if not older:
            return newest, Links()
        until_ns = newest.header.stamp.ns - LATELY_NS
        return newest, next((each for each in older if each.header.stamp.ns <= until_ns), older[-1])

    def _decoded(self, came: Came, cls: type[M]) -> M | None:
        try:
            return message_of(came, cls)
        except DecodeError:
            self.malformed += 1
            return None
