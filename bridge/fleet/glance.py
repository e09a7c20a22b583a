"""The newest of what a run publishes for people: kept as it comes, decoded only when somebody looks."""

from __future__ import annotations

from collections import deque
from typing import TypeVar

from bridge.bus.messages import AircraftState, DecodeError, Links, Message, decode

LINKS_KEPT = 6
"""Link reports come five times per second of sim time: the oldest kept is a second older than the newest."""
M = TypeVar("M", bound=Message)


class Glance:
    """States of UA and link reports. Payloads may come in any thread, and at any rate, at next to no cost.

    Attributes:
        malformed: payloads that were looked at and could not be decoded.
    """

    def __init__(self) -> None:
        self.malformed = 0
        self._states: dict[str, bytes] = {}
        self._links: deque[bytes] = deque(maxlen=LINKS_KEPT)

    def state_came(self, key: str, payload: bytes) -> None:
        """Keep the state of a UA."""
        self._states[key] = payload

    def links_came(self, payload: bytes) -> None:
        """Keep a report on all links."""
        self._links.append(payload)

    def states(self) -> dict[str, AircraftState]:
        """The newest state of each UA, by its id."""
        decoded = (self._decoded(payload, AircraftState) for payload in list(self._states.values()))
        return {state.header.frame_id: state for state in decoded if state is not None}

    def links(self) -> tuple[Links, Links]:
        """The newest report on all links, and the one a second of sim time before it, or the oldest there is."""
        kept = list(self._links)
        if not kept:
            return Links(), Links()
        newest = self._decoded(kept[-1], Links) or Links()
        before = self._decoded(kept[0], Links) if len(kept) > 1 else None
        return newest, before or Links(newest.header)

    def _decoded(self, payload: bytes, cls: type[M]) -> M | None:
        try:
            return decode(payload, cls)
        except DecodeError:
            self.malformed += 1
            return None
