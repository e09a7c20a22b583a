"""What the parts of a record are called, and which files of the run directory they are in."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Self

from bridge.bus.keys import checked_chunk
from bridge.record.streams import PACKED

STREAM_FOLDER = "streams"
INPUT_FOLDER = "inputs"
REPORT_FOLDER = "reports"
PROVENANCE_FILE = "provenance.json"
NODE_LENGTH_MAX = 200
"""File systems allow 255 bytes; the suffix has to fit, too."""


class Kind(StrEnum):
    """What a stream holds, in the order in which things happen within a tick."""

    FROM_AUTOPILOT = "from_autopilot"
    TO_AUTOPILOT = "to_autopilot"
    LOGGED = "logged"
    PACKETS = "packets"
    TO_MODEM = "to_modem"
    FROM_MODEM = "from_modem"


_SERIAL = {Kind.TO_MODEM, Kind.FROM_MODEM}
_MAVLINK = {Kind.FROM_AUTOPILOT, Kind.TO_AUTOPILOT}
_OTHERS = set(Kind) - _MAVLINK - _SERIAL


@dataclass(frozen=True, slots=True)
class Stream:
    """The name of one stream.

    Raises:
        ValueError: the node id cannot be part of a file name.
    """

    kind: Kind
    node: str
    radio: str = ""
    """Of a modem's serial line."""

    def __post_init__(self) -> None:
        checked_file_name(self.node)
        if self.kind in _SERIAL:
            checked_file_name(self.radio)

    def __str__(self) -> str:
        if self.kind in _SERIAL:
            return f"modem/{self.node}/{self.radio}/{self.kind}"
        if self.kind in _MAVLINK:
            return f"mavlink/{self.node}/{self.kind}"
        return f"{self.kind}/{self.node}"

    def path(self, run: Path) -> Path:
        """Its file in the run directory ``run``."""
        return run / STREAM_FOLDER / f"{self}.bin"

    @classmethod
    def parse(cls, name: str) -> Self:
        """The stream of that name.

        Raises:
            ValueError: no stream is called so.
        """
        match name.split("/"):
            case ["modem", node, radio, kind] if kind in _SERIAL:
                return cls(Kind(kind), node, radio)
            case ["mavlink", node, kind] if kind in _MAVLINK:
                return cls(Kind(kind), node)
            case [kind, node] if kind in _OTHERS:
                return cls(Kind(kind), node)
        raise ValueError(
            f"{name!r} is not the name of a stream: there are mavlink/<node>/from_autopilot, "
            "mavlink/<node>/to_autopilot, modem/<node>/<radio>/to_modem, modem/<node>/<radio>/from_modem, "
            "logged/<node> and packets/<node>"
        )


def from_autopilot(node: str) -> Stream:
    """MAVLink bytes that the autopilot of ``node`` had written when a tick was read."""
    return Stream(Kind.FROM_AUTOPILOT, node)


def to_autopilot(node: str) -> Stream:
    """MAVLink bytes that were written to the autopilot of ``node`` at a tick."""
    return Stream(Kind.TO_AUTOPILOT, node)


def packets(node: str) -> Stream:
    """What ``node`` transmitted and the radio took: an entry per packet, see `bridge.record.packets`."""
    return Stream(Kind.PACKETS, node)


def logged(node: str) -> Stream:
    """What the agent of ``node`` logged and reported: an entry each, see `bridge.record.logged`."""
    return Stream(Kind.LOGGED, node)


def checked_file_name(name: str) -> str:
    """Return ``name`` if it can be (part of) a file name, else raise ValueError."""
    if len(checked_chunk(name)) > NODE_LENGTH_MAX:
        raise ValueError(f"{name[:20]!r}... is longer than {NODE_LENGTH_MAX} characters")
    return name


def inputs_path(run: Path, node: str) -> Path:
    """The file of what came to ``node`` from outside.

    Raises:
        ValueError: the node id cannot be part of a file name.
    """
    return run / INPUT_FOLDER / f"{checked_file_name(node)}.jsonl"


def report_path(run: Path, process: str) -> Path:
    """The file of what a process of the run reports.

    Raises:
        ValueError: the name cannot be part of a file name.
    """
    return run / REPORT_FOLDER / f"{checked_file_name(process)}.json"


def streams_of(run: Path) -> list[Stream]:
    """The streams that the run directory ``run`` has, sorted by name.

    Raises:
        ValueError: there is a .bin file, or a packed one, whose name is not that of a stream.
    """
    folder = run / STREAM_FOLDER
    found: set[Stream] = set()
    for file in (*folder.rglob("*.bin"), *folder.rglob("*.bin.zst")):
        try:
            found.add(
                Stream.parse(file.relative_to(folder).as_posix().removesuffix(PACKED).removesuffix(".bin"))
            )
        except ValueError as error:
            raise ValueError(f"{file}: {error}") from error
    return sorted(found, key=str)


def as_seen_from(run: Path, text: str) -> str:
    """A text in which paths below a directory are as seen from it: it holds wherever the directory lies later."""
    return text.replace(f"{run}/", "")
