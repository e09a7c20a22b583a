"""All links of one daemon: their numbers, how many there may be, and how much each may send."""

from __future__ import annotations

import asyncio
import logging
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Final

from aps.links.allowance import DEFAULT_FRAMES_PER_S, Allowance
from aps.links.link import Link, Role
from aps.wire.framer import Frame
from aps.wire.signing import HeardStreams

DEFAULT_MAX_CLIENTS: Final = 64
LINK_IDS: Final = 256
TELL_EVERY_S: Final = 10.0
"""Of what a peer does wrong all the time, the log has one line in this time."""
_ALLOWANCE: Final = "allowance"

_log = logging.getLogger(__name__)


class LinkTable:
    """Owns the links (`LinkOwner`); the callbacks run in the event loop.

    Args:
        on_open: a link is there, with its ``id``.
        on_frames: frames from a link, and of how many bytes (the list may be empty).
        on_close: a link is gone.
        clock: what time it is for a link's traffic, ns.
        first_id: id of the first link; each further one gets the next (ids are not used twice).
        max_clients: further links are closed at once and counted (the autopilot's do not count).
        frames_per_s: what a client may send for good; see ``aps.links.allowance``.
    """

    def __init__(
        self,
        on_open: Callable[[Link], None],
        on_frames: Callable[[Link, Sequence[Frame], int], None],
        on_close: Callable[[Link], None],
        clock: Callable[[], int],
        *,
        first_id: int,
        max_clients: int = DEFAULT_MAX_CLIENTS,
        frames_per_s: float = DEFAULT_FRAMES_PER_S,
    ) -> None:
        self.links: dict[int, Link] = {}
        self.max_clients = max_clients
        self.accepted = 0
        self.turned_away = 0
        self.leaving = 0
        """Links that are gone but not yet forgotten: they count towards ``max_clients``."""
        self.listeners = False
        """Clients from now on only listen: their ids are -1, -2, ..., which no other link has."""
        self._on_open, self._on_frames, self._on_close, self._clock = on_open, on_frames, on_close, clock
        self._frames_per_s = frames_per_s
        self._allowances: dict[int, Allowance] = {}
        self._heard: dict[bytes, HeardStreams] = {}
        """By key."""
        self._past: Counter[str] = Counter()
        self._told_s: dict[str, float] = {}
        self._next_id = first_id
        self._next_listener = -1

    def __iter__(self) -> Iterator[Link]:
        return iter(list(self.links.values()))

    @property
    def clients(self) -> dict[int, Link]:
        """The links of clients, by id."""
        return {number: link for number, link in self.links.items() if link.role is Role.CLIENT}

    def flush(self) -> None:
        """Write what waits on all links, as far as they take it."""
        for link in self.links.values():
            outbox = link.outbox
            if outbox.waiting:
                outbox.flush()

    def close(self) -> None:
        """Drop all links."""
        for link in self:
            link.abort()

    # What happens (LinkOwner).

    def link_opened(self, link: Link) -> bool:
        """There is a peer; False turns it away."""
        if link.role is Role.CLIENT and len(self._allowances) + self.leaving >= self.max_clients:
            self.turned_away += 1
            self._tell("turned away", f"{link.name} turned away: {self.max_clients} are connected already")
            return False
        self._number(link, listener=self.listeners and link.role is Role.CLIENT)
        self._share_key(link)
        self.accepted += 1
        if link.role is Role.CLIENT:
            self._allowances[link.id] = Allowance(self._frames_per_s)
            _log.info("client %s connected", link.name)
        self._on_open(link)
        return True

    def link_data(self, link: Link, data: bytes) -> None:
        """Bytes came."""
        allowance = self._allowances.get(link.id)
        if allowance is None:
            self._on_frames(link, link.receive(data, self._clock()), len(data))
            return
        now_s = asyncio.get_running_loop().time()
        if not link.can_wait and allowance.charge(0, 0, now_s) > 0.0:
            link.counters.dropped_rate += 1
            self._tell(f"rate of {link.name}", f"{link.name} sends more than it may: datagrams are dropped")
            return
        counters = link.framer.counters
        skipped, came = counters.skipped_bytes, counters.frames
        frames = link.receive(data, self._clock())
        self._charge(link, allowance, counters.frames - came, counters.skipped_bytes - skipped, now_s)
        self._on_frames(link, frames, len(data))

    def link_closed(self, link: Link, error: Exception | None) -> None:
        """The peer is gone."""
        if self.links.pop(link.id, None) is None:
            return
        self._allowances.pop(link.id, None)
        self._past.update(_totals(link))
        if link.role is Role.CLIENT:
            _log.info("client %s left%s", link.name, f" ({error})" if error is not None else "")
        self._on_close(link)

    def _charge(self, link: Link, allowance: Allowance, frames: int, garbage: int, now_s: float) -> None:
        wait_s = allowance.charge(frames, garbage, now_s)
        if wait_s <= 0.0 or not link.can_wait:
            return
        link.counters.throttled += 1
        self._tell(f"rate of {link.name}", f"{link.name} sends more than it may: it has to wait")
        link.hold(_ALLOWANCE)
        asyncio.get_running_loop().call_later(wait_s, link.release, _ALLOWANCE)

    def _tell(self, what: str, text: str) -> None:
        """Log a warning, but not all the time."""
        now_s = asyncio.get_running_loop().time()
        if now_s - self._told_s.get(what, -TELL_EVERY_S) >= TELL_EVERY_S:
            if len(self._told_s) > self.max_clients:
                self._told_s.clear()
            self._told_s[what] = now_s
            _log.warning("%s", text)

    def _share_key(self, link: Link) -> None:
        """Links of one key have ids of their own, the lowest that are free (ArduPilot remembers 16), and one memory."""
        signing, key = link.signing, link.rules.key
        if signing is None or key is None:
            return
        signing.heard = self._heard.setdefault(key, signing.heard)
        others = {
            each.signing.link_id
            for each in self
            if each.signing and each.rules.key == key and each is not link
        }
        signing.link_id = next((number for number in range(LINK_IDS) if number not in others), LINK_IDS - 1)

    # Numbers.

    def _number(self, link: Link, *, listener: bool) -> None:
        if listener:
            link.id, self._next_listener = self._next_listener, self._next_listener - 1
        else:
            link.id, self._next_id = self._next_id, self._next_id + 1
        self.links[link.id] = link

    def renumber(self, link: Link, *, listener: bool) -> None:
        """Make a listener a link that is heard, or the other way round."""
        del self.links[link.id]
        allowance = self._allowances.pop(link.id, None)
        self._number(link, listener=listener)
        if allowance is not None:
            self._allowances[link.id] = allowance

    def reserve(self, link_id: int) -> None:
        """Give no link this id or a lower one from now on."""
        self._next_id = max(self._next_id, link_id + 1)

    # Counters.

    def statistics(self) -> dict[str, Any]:
        """Counters of all links, those that are gone included, as plain data."""
        totals = Counter(self._past)
        for link in self:
            totals.update(_totals(link))
        return {
            "clients": [dict(link.statistics(self._clock())) for link in self.clients.values()],
            "client_totals": dict(sorted(totals.items())),
            "accepted": self.accepted,
            "turned_away": self.turned_away,
        }


def _totals(link: Link) -> Counter[str]:
    """What adds up over links: of clients only."""
    if link.role is not Role.CLIENT:
        return Counter()
    framer, outbox, traffic = link.framer.counters, link.outbox.counters, link.traffic
    return Counter(
        {
            "frames_in": traffic.frames,
            "bytes_in": traffic.bytes,
            "lost_in": traffic.lost,
            "bad_crc": framer.bad_crc,
            "skipped_bytes": framer.skipped_bytes,
            "frames_out": outbox.written_frames,
            "bytes_out": outbox.written_bytes,
            "dropped_full": outbox.dropped_full,
            "dropped_closed": outbox.dropped_closed,
            "stalls": outbox.stalls,
            "throttled": link.counters.throttled,
            "dropped_rate": link.counters.dropped_rate,
            "dropped_in": link.counters.dropped_in,
            "dropped_out": link.counters.dropped_out,
            "dropped_rate_out": link.counters.dropped_rate_out,
        }
    )
