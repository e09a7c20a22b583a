"""The newest data package of each other node, decoded when it is looked at: most are replaced before that."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from bridge.agents.client import UaClient
from bridge.agents.frames import has_fix
from bridge.bus.messages import DataPackage


class LatestPackages(Mapping[str, DataPackage]):
    """By node id, as text or as a number.

    A node whose newest packet is no DataPackage is not in it; that is counted in ``ua.malformed``.

    Nor is one that did not know where it was: there is no nan in the states here.

    Args:
        ua: the node that received them.

    Attributes:
        raw: the bytes of the newest packet of each node, readable or not.
    """

    def __init__(self, ua: UaClient) -> None:
        self.raw: dict[str, bytes] = {}
        self._ua = ua
        self._read: dict[str, DataPackage | None] = {}

    def take(self, sender: str, payload: bytes) -> None:
        """Keep the bytes of a packet."""
        self.raw[sender] = payload
        self._read.pop(sender, None)

    def __getitem__(self, sender: str | int) -> DataPackage:
        sender = str(sender)
        if sender not in self._read:
            package = self._ua.read(self.raw[sender], DataPackage)
            self._read[sender] = package if package is not None and has_fix(package.state) else None
        found = self._read[sender]
        if found is None:
            raise KeyError(sender)
        return found

    def __iter__(self) -> Iterator[str]:
        return (sender for sender in tuple(self.raw) if sender in self)

    def __len__(self) -> int:
        return sum(1 for _ in self)
