"""Whatever bytes come from an interface or a radio: nothing is raised, and each packet is forwarded or counted."""

from __future__ import annotations

import socket
from ipaddress import IPv4Address, IPv4Network

from hypothesis import example, given
from hypothesis import strategies as st

from lostlink.attach.forwarder import Forwarder
from tests.unit.lostlink.attach.packets import ip_packet

SUBNET = IPv4Network("10.42.0.0/24")
ADDRESSES = {str(number): SUBNET[number + 1] for number in range(3)}
MTU = 576
NEARLY = st.builds(
    lambda whole, place, value: whole[:place] + bytes([value]) + whole[place + 1 :],
    st.builds(ip_packet, st.sampled_from(["10.42.0.2", "10.42.0.255", "8.8.8.8"]), st.binary(max_size=80)),
    st.integers(0, 25),
    st.integers(0, 255),
)


@given(st.lists(st.one_of(st.binary(max_size=80), NEARLY)))
@example([b"\x45"])
@example([b"\x46\x00\x00\x18" + bytes(20)])
def test_every_packet_is_forwarded_or_counted(packets: list[bytes]) -> None:
    out, back = (Forwarder("0", ADDRESSES, SUBNET, MTU) for _ in range(2))
    went = [out.outgoing(raw) for raw in packets]
    came = [back.incoming(raw) for raw in packets]
    assert out.sent == len(went) - went.count(None)
    assert out.sent + sum(out.dropped.values()) == len(packets)
    assert back.received == came.count(True)
    assert back.received + sum(back.dropped.values()) == len(packets)


@given(st.integers(0, 2**32 - 1).map(IPv4Address), st.binary(max_size=MTU - 20))
@example(IPv4Address("10.42.0.3"), b"")
def test_whole_packets_go_where_their_address_says(destination: IPv4Address, payload: bytes) -> None:
    raw = ip_packet(str(destination), payload)
    to = Forwarder("0", ADDRESSES, SUBNET, MTU).outgoing(raw)
    by_address = {
        socket.inet_ntoa(address.packed): node for node, address in ADDRESSES.items() if node != "0"
    }
    for_all = destination.is_multicast or str(destination) in ("255.255.255.255", "10.42.0.255")
    assert to == ("all" if for_all else by_address.get(str(destination)))
