"""What may pass a link: filters by message, system and component, and rates. No I/O, no clock."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Final

from aps.wire.framer import Frame

NS_PER_S: Final = 1_000_000_000


@dataclass(frozen=True, slots=True)
class Filter:
    """Which frames pass in one direction. A sender's ids count, not a target's."""

    allow_messages: frozenset[int] | None = None
    """If set, only these message ids pass."""
    block_messages: frozenset[int] = frozenset()
    allow_systems: frozenset[int] | None = None
    block_systems: frozenset[int] = frozenset()
    allow_components: frozenset[int] | None = None
    block_components: frozenset[int] = frozenset()

    def passes(self, frame: Frame) -> bool:
        """Whether a frame passes."""
        return (
            _allowed(frame.msg_id, self.allow_messages, self.block_messages)
            and _allowed(frame.sysid, self.allow_systems, self.block_systems)
            and _allowed(frame.compid, self.allow_components, self.block_components)
        )


def _allowed(value: int, allow: frozenset[int] | None, block: frozenset[int]) -> bool:
    return value not in block and (allow is None or value in allow)


@dataclass(frozen=True, slots=True)
class LinkRules:
    """What may pass a link."""

    read_only: bool = False
    """The peer may only listen: nothing that it sends is taken."""
    incoming: Filter | None = None
    outgoing: Filter | None = None
    max_rate_hz: Mapping[int, float] = field(default_factory=lambda: MappingProxyType({}))
    """Message id -> how often it goes out at most, per sender; key -1 is for all ids that are not named."""

    key: bytes | None = field(default=None, repr=False)
    """If set, what goes out is signed with it, and what comes in without its signature is not taken."""

    def __post_init__(self) -> None:
        for msg_id, rate_hz in self.max_rate_hz.items():
            if not rate_hz > 0.0:
                raise ValueError(f"the rate of message {msg_id} must be positive, not {rate_hz}")

    def takes(self, frame: Frame) -> bool:
        """Whether a frame may come in."""
        return not self.read_only and (self.incoming is None or self.incoming.passes(frame))

    def gives(self, frame: Frame) -> bool:
        """Whether a frame may go out, as far as filters say."""
        return self.outgoing is None or self.outgoing.passes(frame)


NO_RULES: Final = LinkRules()

MAX_SENDERS: Final = 4096
"""Bound on what is remembered per link: beyond it all is forgotten, which lets some frames through early."""
_OTHERS: Final = -1


class RateLimiter:
    """Thins one link's outgoing messages. Frames with a target (answers, commands) are never thinned."""

    def __init__(self, max_rate_hz: Mapping[int, float]) -> None:
        self._period_ns = {msg_id: round(NS_PER_S / rate_hz) for msg_id, rate_hz in max_rate_hz.items()}
        self._due_ns: dict[tuple[int, int, int], int] = {}

    def passes(self, frame: Frame, now_ns: int) -> bool:
        """Whether a frame may go out now."""
        period_ns = self._period_ns.get(frame.msg_id) or self._period_ns.get(_OTHERS)
        if period_ns is None or frame.target_system:
            return True
        key = (frame.msg_id, frame.sysid, frame.compid)
        due_ns = self._due_ns.get(key, now_ns)
        if now_ns < due_ns:
            return False
        if len(self._due_ns) >= MAX_SENDERS:
            self._due_ns.clear()
        # On the grid, so that jitter does not slow a message down; after a pause from now on.
        self._due_ns[key] = max(due_ns + period_ns, now_ns + period_ns // 2)
        return True
