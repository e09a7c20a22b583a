"""IPv4 packets by RFC 791, section 3.1, written out."""

from __future__ import annotations

import socket
import struct


def ip_packet(
    destination: str, payload: bytes = b"hello", *, source: str = "10.42.0.1", options: bytes = b""
) -> bytes:
    """Version and header length, ToS, length, id, flags, TTL 64, UDP, no checksum, both addresses, options."""
    length = 20 + len(options) + len(payload)
    first = 0x40 | (20 + len(options)) // 4
    ends = socket.inet_aton(source), socket.inet_aton(destination)
    return struct.pack(">BBHHHBBH4s4s", first, 0, length, 7, 0, 64, 17, 0, *ends) + options + payload
