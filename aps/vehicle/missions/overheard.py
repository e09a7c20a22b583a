"""The mission protocol from beside: which lists an autopilot holds, by what others send it and ask of it.

A list counts once it was transferred whole: an upload when the autopilot acknowledges it, a download with its last
item. Nothing is asked. (https://mavlink.io/en/services/mission.html)
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from aps.vehicle.missions.items import KINDS, MissionItem
from aps.wire.dialect import mavlink, message_fields
from aps.wire.framer import Frame

_ITEM, _PARTIAL, _COUNT, _CLEAR, _ACK, _ITEM_INT = 39, 38, 44, 45, 47, 73
OVERHEARD: Final = frozenset({_ITEM, _PARTIAL, _COUNT, _CLEAR, _ACK, _ITEM_INT})
"""Ids of the messages of the protocol that say what a list has."""
_KIND_NAMES: Final = {number: name for name, number in KINDS.items()}
_ALL: Final = int(mavlink.MAV_MISSION_TYPE_ALL)
_ACCEPTED: Final = int(mavlink.MAV_MISSION_ACCEPTED)
_SEQUENCE: Final = int(mavlink.MAV_MISSION_INVALID_SEQUENCE)
_TARGETS: Final = (2, 3)
"""MISSION_ITEM.current of what is no item: a target for GUIDED, or a new height."""
_Peer = tuple[int, int]
_Fields = Mapping[str, Any]


@dataclass
class _Transfer:
    """Items ``first`` to ``last``, of which some have passed."""

    peer: _Peer
    first: int
    last: int
    is_whole: bool = True
    items: dict[int, MissionItem] = field(default_factory=dict)

    @property
    def is_complete(self) -> bool:
        return len(self.items) > self.last - self.first

    def take(self, seq: int, item: MissionItem) -> None:
        if self.first <= seq <= self.last:
            self.items[seq] = item

    def over(self, before: Sequence[MissionItem]) -> tuple[MissionItem, ...]:
        """The list after it: what is not whole replaces a part of the one before."""
        numbers = range(self.first, self.last + 1)
        if self.is_whole:
            return tuple(self.items[seq] for seq in numbers)
        return tuple(self.items.get(seq, item) for seq, item in enumerate(before))


class Overheard:
    """The lists of one autopilot.

    Attributes:
        lists: by kind (``KINDS``), as the autopilot counts: ArduPilot's mission has home as item 0. A kind is missing
            until one was transferred.
    """

    def __init__(self) -> None:
        self.lists: dict[str, tuple[MissionItem, ...]] = {}
        self._uploads: dict[int, _Transfer] = {}
        self._clears: dict[int, _Peer] = {}
        self._downloads: dict[tuple[int, _Peer], _Transfer] = {}
        self._to: dict[int, Callable[[int, _Peer, _Fields], None]] = {
            _COUNT: self._upload_begins,
            _PARTIAL: self._part_begins,
            _ITEM: self._item_goes,
            _ITEM_INT: self._item_goes,
            _CLEAR: self._clear_asked,
        }
        self._from: dict[int, Callable[[int, _Peer, _Fields], None]] = {
            _COUNT: self._download_begins,
            _ITEM: self._item_comes,
            _ITEM_INT: self._item_comes,
            _ACK: self._acknowledged,
        }

    def take(self, frame: Frame, *, to_autopilot: bool) -> None:
        """Take a frame of the link; others than ``OVERHEARD`` are passed over."""
        handler = (self._to if to_autopilot else self._from).get(frame.msg_id)
        fields = message_fields(frame.raw) if handler is not None else {}
        if handler is None or not fields:
            return
        there = (frame.target_system, frame.target_component)
        handler(int(fields["mission_type"]), (frame.sysid, frame.compid) if to_autopilot else there, fields)

    def _upload_begins(self, kind: int, peer: _Peer, fields: _Fields) -> None:
        self._clears.pop(kind, None)
        self._uploads[kind] = _Transfer(peer, 0, int(fields["count"]) - 1)

    def _part_begins(self, kind: int, peer: _Peer, fields: _Fields) -> None:
        first, last = int(fields["start_index"]), int(fields["end_index"])
        self._uploads[kind] = _Transfer(peer, first, last, is_whole=False)

    def _item_goes(self, kind: int, peer: _Peer, fields: _Fields) -> None:
        upload, item = self._uploads.get(kind), _item(fields)
        if upload is not None and upload.peer == peer and item is not None:
            upload.take(int(fields["seq"]), item)

    def _clear_asked(self, kind: int, peer: _Peer, fields: _Fields) -> None:  # noqa: ARG002
        for each in KINDS.values() if kind == _ALL else (kind,):
            self._uploads.pop(each, None)
        self._clears[kind] = peer

    def _acknowledged(self, kind: int, peer: _Peer, fields: _Fields) -> None:
        result = int(fields["type"])
        upload = self._uploads.get(kind)
        if upload is not None and upload.peer == peer:
            if result == _ACCEPTED and upload.is_complete:
                self._keep(kind, upload)
            if upload.is_complete if result == _ACCEPTED else result != _SEQUENCE:
                del self._uploads[kind]  # an acknowledgement before the end is late, of a transfer before
        elif self._clears.get(kind) == peer:
            del self._clears[kind]
            if result == _ACCEPTED:
                names = KINDS if kind == _ALL else [_KIND_NAMES[kind]] if kind in _KIND_NAMES else []
                self.lists |= dict.fromkeys(names, ())

    def _download_begins(self, kind: int, peer: _Peer, fields: _Fields) -> None:
        self._downloads[kind, peer] = _Transfer(peer, 0, int(fields["count"]) - 1)
        self._end_download(kind, peer)

    def _item_comes(self, kind: int, peer: _Peer, fields: _Fields) -> None:
        download, item = self._downloads.get((kind, peer)), _item(fields)
        if download is not None and item is not None:
            download.take(int(fields["seq"]), item)
            self._end_download(kind, peer)

    def _end_download(self, kind: int, peer: _Peer) -> None:
        download = self._downloads[kind, peer]
        if download.is_complete:
            del self._downloads[kind, peer]
            self._keep(kind, download)

    def _keep(self, kind: int, transfer: _Transfer) -> None:
        name = _KIND_NAMES.get(kind)
        before = self.lists.get(name or "", ())
        if name is not None and (transfer.is_whole or len(before) > transfer.last):
            self.lists[name] = transfer.over(before)


def _item(fields: _Fields) -> MissionItem | None:
    """The item of a MISSION_ITEM_INT or a MISSION_ITEM; None if it is none."""
    if int(fields["current"]) in _TARGETS:
        return None
    try:
        if isinstance(fields["x"], int):
            return MissionItem.from_fields(fields)
        params = tuple(
            float(fields[name]) for name in ("param1", "param2", "param3", "param4", "x", "y", "z")
        )
        return MissionItem(int(fields["command"]), params, int(fields["frame"]))  # type: ignore[arg-type]
    except ValueError:
        return None
