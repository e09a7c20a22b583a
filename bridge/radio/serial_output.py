"""What comes out of the modems of a run."""

from __future__ import annotations

from typing import NamedTuple


class SerialOutput(NamedTuple):
    """Bytes that have come out at the serial side of a node's modem.

    Attributes:
        node: its place among all of the run.
        at_ns: when the last of them did.
        data: the bytes.
        network: place of the modem's network.
    """

    node: int
    at_ns: int
    data: bytes
    network: int = 0
