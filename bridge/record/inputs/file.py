"""What came to a node from outside (a GCS, an operator, a program) and took effect: one JSON object per line.

    {"tick_ns": 1250000000, "kind": "open", "link": 3}
    {"tick_ns": 1250000000, "kind": "frame", "link": 3, "name": "SET_MODE", "hex": "fd09..."}
    {"tick_ns": 1300000000, "kind": "command", "verb": "takeoff", "altitude_rel_m": 20.0}
    {"tick_ns": 1350000000, "kind": "packet", "radio": "main", "to": "1", "channel": "ip", "hex": "4500..."}
    {"tick_ns": 1300000000, "kind": "serial", "radio": "telemetry", "hex": "fe09..."}
    {"tick_ns": 9900000000, "kind": "close", "link": 3}

A link is opened before it has frames, and closed once at most; after that its number may be opened again. Of a
command, fields of CommandGoal that are 0 or empty are left out; ``arguments`` is an object. ``name`` is for people:
it is not read.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, TextIO

from bridge.record.inputs.fields import InputError, PacketWay, RecordedInput, from_fields, to_fields
from bridge.record.names import INPUT_FOLDER, inputs_path

__all__ = [
    "InputError",
    "InputWriter",
    "PacketWay",
    "RecordedInput",
    "all_inputs",
    "inputs_of",
    "read_inputs",
]


class InputWriter:
    """Writes the inputs of one node, line by line; the file is made with the first one."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file: TextIO | None = None
        self._order = _Order()

    def write(self, item: RecordedInput) -> None:
        """Append an input; it is with the operating system when this returns.

        Raises:
            InputError: its tick is before that of the last one, or its link is not open (or is so already).
            OSError: the file cannot be made or written.
        """
        self._order.check(item)
        if self._file is None:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            self._file = self._path.open("w", encoding="ascii")
        self._file.write(json.dumps(to_fields(item)) + "\n")
        self._file.flush()

    def close(self) -> None:
        """Close the file, if there is one."""
        if self._file is not None:
            self._file.close()


def read_inputs(path: Path) -> list[RecordedInput]:
    """The inputs in a file, in their order. Empty lines are passed over.

    Raises:
        InputError: a line is wrong; the text has file, line, key and what is allowed.
        OSError: the file cannot be read.
    """
    return list(_read(path))


def inputs_of(run: Path, node: str) -> list[RecordedInput]:
    """The inputs of a node in the run directory ``run``; none if it has no such file.

    Raises:
        InputError, OSError: as `read_inputs`.
        ValueError: the node id cannot be part of a file name.
    """
    path = inputs_path(run, node)
    return read_inputs(path) if path.exists() else []


def all_inputs(run: Path) -> dict[str, list[RecordedInput]]:
    """The inputs of every node of the run directory ``run`` that has any.

    Raises:
        InputError, OSError: as `read_inputs`.
    """
    return {file.stem: read_inputs(file) for file in sorted((run / INPUT_FOLDER).glob("*.jsonl"))}


def _read(path: Path) -> Iterator[RecordedInput]:
    order = _Order()
    with path.open("rb") as file:
        for number, line in enumerate(file, 1):
            if line.isspace():
                continue
            try:
                item = from_fields(_object(line))
                order.check(item)
            except InputError as error:
                raise InputError(f"{path}:{number}: {error}") from error
            yield item


def _object(line: bytes) -> dict[str, Any]:
    try:
        content = json.loads(line, object_pairs_hook=_without_repeats)
    except InputError:
        raise
    except (ValueError, RecursionError) as error:
        raise InputError(f"not JSON: {error}") from error
    if not isinstance(content, dict):
        raise InputError(f"a JSON object is expected, not {line.decode(errors='replace').strip()[:40]!r}")
    return content


def _without_repeats(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    content: dict[str, Any] = {}
    for key, value in pairs:
        if key in content:
            raise InputError(f"key {key!r} is there more than once")
        content[key] = value
    return content


class _Order:
    """What one input demands of those before it."""

    def __init__(self) -> None:
        self._tick_ns = 0
        self._open: set[int] = set()

    def check(self, item: RecordedInput) -> None:
        """Take the next input, or raise InputError."""
        if item.tick_ns < self._tick_ns:
            raise InputError(
                f"key 'tick_ns': {item.tick_ns} goes back; at least {self._tick_ns}, that of the input before"
            )
        if item.link is not None:
            self._check_link(item.kind, item.link)
        self._tick_ns = item.tick_ns

    def _check_link(self, kind: str, link: int) -> None:
        if kind == "open":
            if link in self._open:
                raise InputError(f"key 'link': link {link} is open already; close it first")
            self._open.add(link)
        elif link not in self._open:
            raise InputError(
                f"key 'link': link {link} is not open; an input of kind 'open' has to come first"
            )
        elif kind == "close":
            self._open.discard(link)
