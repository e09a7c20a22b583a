"""Which node an IP packet from a program is for, and what may come back to it. No I/O.

What comes from the interface is any bytes: what is no IPv4 packet, or is for no node, is dropped and counted.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from enum import StrEnum
from ipaddress import IPv4Address, IPv4Network
from typing import Final

from bridge.bus.keys import ALL
from bridge.host.node import ENTERING_MAX, ENTERING_MAX_BYTES
from lostlink.attach.addresses import LIMITED_BROADCAST

HEADER_MIN_BYTES: Final = 20
"""Of IPv4 without options (RFC 791, section 3.1)."""
_DESTINATION: Final = slice(16, 20)


class Dropped(StrEnum):
    """Why a packet went no further, in the words that a summary has."""

    NOT_IP = "not IP"
    IPV6 = "IPv6"
    MALFORMED = "malformed"
    TOO_LONG = "longer than the MTU"
    NO_NODE = "for no node on the radio"
    TOO_MANY = "more than a node takes in a tick"
    NOT_READ = "came faster than they could be read"
    NOT_TAKEN = "not taken by the interface"


class Forwarder:
    """Decides for one node.

    Args:
        node: its id.
        addresses: of all nodes on its radio network, by id; its own among them.
        subnet: that they are in.
        mtu_bytes: longest packet.

    Attributes:
        sent, sent_bytes: what went to the radio.
        received, received_bytes: what came from it.
        dropped: the rest, by reason.
    """

    def __init__(
        self, node: str, addresses: Mapping[str, IPv4Address], subnet: IPv4Network, mtu_bytes: int
    ) -> None:
        self._to = {address.packed: each for each, address in addresses.items() if each != node}
        self._to |= {address.packed: ALL for address in (subnet.broadcast_address, LIMITED_BROADCAST)}
        self._mtu_bytes = mtu_bytes
        self._in_tick = self._in_tick_bytes = 0
        self.sent = self.sent_bytes = self.received = self.received_bytes = 0
        self.dropped: Counter[Dropped] = Counter()

    def tick(self) -> None:
        """The node takes as much again."""
        self._in_tick = self._in_tick_bytes = 0

    def outgoing(self, raw: bytes) -> str | None:
        """Whom a packet of the program's is for, a node or all; None if it goes nowhere, which is counted."""
        why = self._why_dropped(raw)
        to = None if why is not None else self._addressee(raw[_DESTINATION])
        if to is None:
            self.dropped[why or Dropped.NO_NODE] += 1
            return None
        self._in_tick += 1
        self._in_tick_bytes += len(raw)
        self.sent += 1
        self.sent_bytes += len(raw)
        return to

    def _why_dropped(self, raw: bytes) -> Dropped | None:
        if (why := _mistake(raw)) is not None:
            return why
        if len(raw) > self._mtu_bytes:
            return Dropped.TOO_LONG
        is_full = self._in_tick >= ENTERING_MAX or self._in_tick_bytes + len(raw) > ENTERING_MAX_BYTES
        return Dropped.TOO_MANY if is_full else None

    def incoming(self, raw: bytes) -> bool:
        """Whether what the radio delivered is a packet for the program; the rest is counted."""
        why = _mistake(raw)
        if why is not None:
            self.dropped[why] += 1
            return False
        self.received += 1
        self.received_bytes += len(raw)
        return True

    def summary(self) -> str:
        """What went through it, in a line."""
        dropped = "".join(f", {count} dropped ({why})" for why, count in sorted(self.dropped.items()))
        return (
            f"{self.sent} packets sent ({self.sent_bytes} bytes), "
            f"{self.received} received ({self.received_bytes} bytes){dropped}"
        )

    def _addressee(self, packed: bytes) -> str | None:
        return ALL if 224 <= packed[0] <= 239 else self._to.get(packed)


def _mistake(raw: bytes) -> Dropped | None:
    """Why bytes are no whole IPv4 packet (RFC 791, section 3.1); None if they are one."""
    version = raw[0] >> 4 if raw else 0
    if version != 4:
        return Dropped.IPV6 if version == 6 else Dropped.NOT_IP
    header_bytes = 4 * (raw[0] & 0x0F)
    if len(raw) < HEADER_MIN_BYTES or not HEADER_MIN_BYTES <= header_bytes <= len(raw):
        return Dropped.MALFORMED
    return None if int.from_bytes(raw[2:4], "big") == len(raw) else Dropped.MALFORMED
