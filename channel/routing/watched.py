"""What a router of a user's own gives is looked at, at each call."""

from __future__ import annotations

import inspect
from collections.abc import Collection, Iterable, Sequence
from typing import Any

from channel.access.packets import AirPacket, Loss
from channel.checks import is_whole
from channel.own.methods import OwnModelError
from channel.routing.router import Hop, HopRouter, Notice, Onward

_HOPS = "Hops in a list, each to None or another node of the network, delay_ns whole and 0 or more, or a Loss"
_NOTICES = "Notices in a list, with length_bytes and delay_ns that are whole numbers of 0 or more"


class WatchedRouter(HopRouter):
    """A router that does as another one, and gives nothing that no router may give.

    Its methods raise OwnModelError in place of that, with the other's class and where the method is written.

    Args:
        router: the other one.
        nodes: of the network.
    """

    def __init__(self, router: HopRouter, nodes: Collection[int]) -> None:
        self._router, self._nodes = router, nodes
        self.notice_priority = router.notice_priority

    def header_bytes(self, hop: Hop) -> int:
        """What the router says, 0 or more."""
        found = self._router.header_bytes(hop)
        if not is_whole(found):
            raise self._refused("header_bytes", found, "a whole number of 0 or more")
        return int(found)

    def send(self, node: int, packet: AirPacket) -> Onward:
        """What the router says."""
        return self._onward("send", node, self._router.send(node, packet))

    def hand_on(self, node: int, packet: AirPacket, way: Sequence[int]) -> Onward:
        """What the router says."""
        return self._onward("hand_on", node, self._router.hand_on(node, packet, way))

    def refuses(self, node: int, packet: AirPacket) -> Loss | None:
        """What the router says."""
        found = self._router.refuses(node, packet)
        if not (found is None or isinstance(found, Loss)):
            raise self._refused("refuses", found, "a Loss, or None")
        return found

    def first_notice_ns(self, node: int) -> int | None:
        """What the router says."""
        found = self._router.first_notice_ns(node)
        if not (found is None or is_whole(found)):
            raise self._refused("first_notice_ns", found, "whole ns of 0 or more, or None")
        return None if found is None else int(found)

    def notices(self, node: int, now_ns: int) -> tuple[Sequence[Notice], int]:
        """What the router says, and an instant that is still to come."""
        found = self._router.notices(node, now_ns)
        if not (isinstance(found, tuple) and len(found) == 2 and is_whole(found[1]) and found[1] > now_ns):
            raise self._refused("notices", found, f"Notices, and an instant in whole ns after {now_ns}")
        return self._notices("notices", found[0]), int(found[1])

    def take(self, node: int, sender: int, content: object, now_ns: int) -> Sequence[Notice]:
        """What the router says."""
        return self._notices("take", self._router.take(node, sender, content, now_ns))

    def _onward(self, method: str, node: int, found: Any) -> Onward:
        if isinstance(found, Loss):
            return found
        hops = list(found) if isinstance(found, Iterable) else [found]
        if isinstance(found, Hop) or not all(self._may_be(hop, node) for hop in hops):
            raise self._refused(method, found, _HOPS)
        return [hop._replace(delay_ns=int(hop.delay_ns)) for hop in hops]

    def _may_be(self, hop: Any, node: int) -> bool:
        goes = isinstance(hop, Hop) and (hop.to is None or (hop.to != node and hop.to in self._nodes))
        return goes and is_whole(hop.delay_ns)

    def _notices(self, method: str, found: Any) -> Sequence[Notice]:
        notices = list(found) if isinstance(found, Iterable) else [found]
        if isinstance(found, Notice) or not all(map(_is_notice, notices)):
            raise self._refused(method, found, _NOTICES)
        return [
            notice._replace(length_bytes=int(notice.length_bytes), delay_ns=int(notice.delay_ns))
            for notice in notices
        ]

    def _refused(self, method: str, found: object, allowed: str) -> OwnModelError:
        code = inspect.unwrap(getattr(type(self._router), method)).__code__
        place = f"{code.co_filename}:{code.co_firstlineno}"
        name = type(self._router).__name__
        return OwnModelError(f"the router {name}: {place}: {method} gave {found!r}: has to give {allowed}")


def _is_notice(notice: Any) -> bool:
    return isinstance(notice, Notice) and is_whole(notice.length_bytes) and is_whole(notice.delay_ns)
