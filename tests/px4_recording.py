"""What passed between fdm and a real PX4 (tests/data/px4_hil.bin.gz), the first 40 frames and 75 while it took off.

A record is a byte, 1 if PX4 said it, its length in two bytes, little-endian, and its bytes as they came from TCP.
"""

from __future__ import annotations

import gzip
from collections.abc import Iterator
from pathlib import Path

FILE = Path(__file__).parent / "data" / "px4_hil.bin.gz"


def records() -> Iterator[tuple[bool, bytes]]:
    """Whether PX4 said it, and the bytes, in order."""
    data = gzip.decompress(FILE.read_bytes())
    at = 0
    while at < len(data):
        size = int.from_bytes(data[at + 1 : at + 3], "little")
        yield data[at] == 1, data[at + 3 : at + 3 + size]
        at += 3 + size


def recorded(*, from_px4: bool) -> list[bytes]:
    """What one side said."""
    return [data for said_it, data in records() if said_it == from_px4]
