"""What comes to a held daemon from outside, waiting for the next exchange. No I/O, no clock.

An ``Input`` is all that needs to be written down of it: with the same inputs at the same exchanges the
daemon says the same to its autopilot.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final, Literal

from aps.wire.framer import Frame, Framer

PENDING_LIMIT_BYTES: Final = 64 * 1024
"""From here on a client is not read until the next exchange: nothing is lost, TCP makes it wait, and a flood of garbage
costs the UA this much per exchange at most."""


@dataclass(frozen=True, slots=True)
class Input:
    """One thing that a client did."""

    link: int
    """The client's link as the daemon numbers it, from 1 on."""
    kind: Literal["open", "frame", "close"]
    raw: bytes = b""
    """The bytes of a frame, whole; empty for the other kinds."""


class InputQueue:
    """Inputs in the order of their arrival, from clients and from a record."""

    def __init__(self) -> None:
        self._waiting: deque[tuple[Input, Frame | None]] = deque()
        self._bytes: Counter[int] = Counter()
        self._open: set[int] = set()
        """Links that are open once all that waits has been taken."""
        self._closing = 0

    def __len__(self) -> int:
        return len(self._waiting)

    @property
    def closing(self) -> int:
        """Links that are gone but whose inputs still wait."""
        return self._closing

    def opened(self, link: int) -> None:
        """A client is there."""
        self._open.add(link)
        self._waiting.append((Input(link, "open"), None))

    def frames(self, link: int, frames: Iterable[Frame]) -> None:
        """Frames of a client."""
        for frame in frames:
            self._waiting.append((Input(link, "frame", frame.raw), frame))

    def received(self, link: int, size_bytes: int) -> bool:
        """So many bytes came from a client, frames or not; returns whether that is enough until the next exchange."""
        self._bytes[link] += size_bytes
        return self._bytes[link] >= PENDING_LIMIT_BYTES

    def closed(self, link: int) -> None:
        """A client is gone."""
        self._open.discard(link)
        self._closing += 1
        self._waiting.append((Input(link, "close"), None))

    def inject(self, inputs: Sequence[Input]) -> None:
        """Queue recorded inputs.

        Raises:
            ValueError: a link is opened twice, or used without being open; a frame is not one whole frame.
                Nothing has been queued then.
        """
        links = set(self._open)
        framed = [self._checked(item, links) for item in inputs]
        for item, frame in zip(inputs, framed, strict=True):
            if frame is not None:
                self.frames(item.link, [frame])
            elif item.kind == "open":
                self.opened(item.link)
            else:
                self.closed(item.link)

    @staticmethod
    def _checked(item: Input, links: set[int]) -> Frame | None:
        """The frame of an input, if it is one; ``links`` are those open before it, and then after it."""
        if item.link < 1:
            raise ValueError(f"the link of an input is 1 or higher, not {item.link}")
        if (item.kind == "open") == (item.link in links):
            raise ValueError(
                f"{item.kind!r} on link {item.link}, which is {'' if item.link in links else 'not '}open"
            )
        if item.kind == "frame":
            frames = Framer(trusting=True).receive(item.raw)
            if len(frames) != 1 or frames[0].raw != item.raw:
                raise ValueError(
                    f"an input of link {item.link} is not one MAVLink frame: {item.raw.hex(' ')}"
                )
            return frames[0]
        if item.kind == "open":
            links.add(item.link)
        else:
            links.remove(item.link)
        return None

    def take(self) -> list[tuple[Input, Frame | None]]:
        """All that waits, and nothing waits any more."""
        taken = list(self._waiting)
        self._waiting.clear()
        self._bytes.clear()
        self._closing = 0
        return taken
