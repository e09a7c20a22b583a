"""Unicasts go to their node, broadcasts and multicasts to all, and what is nothing of that is counted by reason."""

from __future__ import annotations

from ipaddress import IPv4Address, IPv4Network

import pytest

from lostlink.attach.forwarder import Dropped, Forwarder
from tests.unit.lostlink.attach.packets import ip_packet

ADDRESSES = {"0": IPv4Address("10.42.0.1"), "1": IPv4Address("10.42.0.2"), "gcs": IPv4Address("10.42.0.254")}
MTU = 576


def forwarder() -> Forwarder:
    return Forwarder("0", ADDRESSES, IPv4Network("10.42.0.0/24"), MTU)


@pytest.mark.parametrize(
    ("destination", "to"),
    [
        ("10.42.0.2", "1"),
        ("10.42.0.254", "gcs"),
        ("10.42.0.255", "all"),
        ("255.255.255.255", "all"),
        ("224.0.0.1", "all"),
        ("239.255.255.250", "all"),
        ("10.42.0.1", None),
        ("10.42.0.3", None),
        ("10.43.0.2", None),
        ("240.0.0.1", None),
        ("223.255.255.255", None),
    ],
)
def test_whom_a_packet_is_for(destination: str, to: str | None) -> None:
    one = forwarder()
    assert one.outgoing(ip_packet(destination)) == to
    assert one.dropped == ({} if to else {Dropped.NO_NODE: 1})
    assert (one.sent, one.sent_bytes) == ((1, 25) if to else (0, 0))


def test_more_than_a_node_takes_in_a_tick_is_counted() -> None:
    one, packet = forwarder(), ip_packet("10.42.0.2")
    assert sum(one.outgoing(packet) is not None for _ in range(2500)) == one.sent == 2000
    assert one.dropped == {Dropped.TOO_MANY: 500}
    one.tick()
    assert one.outgoing(packet) == "1"


def test_a_header_with_options_is_one() -> None:
    assert forwarder().outgoing(ip_packet("10.42.0.2", options=bytes(40))) == "1"


WHOLE = ip_packet("10.42.0.2")


@pytest.mark.parametrize(
    ("raw", "why"),
    [
        (b"", Dropped.NOT_IP),
        (b"hello", Dropped.IPV6),  # 0x68: version 6, by chance
        (b"\x00" * 40, Dropped.NOT_IP),
        (b"\x60" + bytes(39), Dropped.IPV6),
        (WHOLE[:19], Dropped.MALFORMED),
        (WHOLE[:-1], Dropped.MALFORMED),
        (WHOLE + b"x", Dropped.MALFORMED),
        (b"\x44" + WHOLE[1:], Dropped.MALFORMED),  # a header of 16 bytes
        (b"\x4f" + WHOLE[1:], Dropped.MALFORMED),  # one of 60 in a packet of 25
        (ip_packet("10.42.0.2", bytes(MTU - 19)), Dropped.TOO_LONG),
    ],
)
def test_what_is_no_packet_is_dropped_and_counted(raw: bytes, why: Dropped) -> None:
    one = forwarder()
    assert one.outgoing(raw) is None
    assert one.dropped == {why: 1}
    if why is not Dropped.TOO_LONG:
        assert not one.incoming(raw)
        assert one.dropped == {why: 2}
    assert (one.sent, one.received) == (0, 0)


def test_what_the_radio_delivers_is_counted_and_told() -> None:
    one = forwarder()
    assert one.outgoing(ip_packet("10.42.0.2", bytes(MTU - 20))) == "1"
    assert one.incoming(WHOLE)
    one.incoming(b"data package")
    one.outgoing(ip_packet("8.8.8.8"))
    assert one.summary() == (
        "1 packets sent (576 bytes), 1 received (25 bytes), 1 dropped (IPv6), 1 dropped (for no node on the radio)"
    )
