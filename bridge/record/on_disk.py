"""Up to which instant the record of a run that goes on can be read: each part that writes notes it when it has flushed.

`live.lock` holds the notes, an int64 each, little-endian, of sim time in ns: of physics, of the radio, and of the nodes
in the scenario's order. All that belongs to earlier instants is with the operating system.
"""

from __future__ import annotations

import os
import struct
from contextlib import suppress
from pathlib import Path
from typing import Final

from bridge.run.directory import LIVE_FILE
from bridge.scenario.model import Scenario

PHYSICS: Final = 0
RADIO: Final = 1
_FIRST_NODE: Final = 2
_NOTE: Final = struct.Struct("<q")


def part_of(scenario: Scenario, node: str) -> int:
    """The part of a run that writes what a node's host has of it."""
    return _FIRST_NODE + scenario.transceiver_ids.index(node)


def note_on_disk(run: Path, part: int, before_ns: int) -> None:
    """All that a part of the run in ``run`` writes of instants before ``before_ns`` has been flushed.

    Where that cannot be noted, whoever waits for it does so to the end of the run.
    """
    with suppress(OSError):
        file = os.open(run / LIVE_FILE, os.O_WRONLY | os.O_CLOEXEC)
        try:
            os.pwrite(file, _NOTE.pack(before_ns), part * _NOTE.size)
        finally:
            os.close(file)


def on_disk_before_ns(run: Path, scenario: Scenario) -> int:
    """Sim time in ns before which tables and streams of a run that goes on have everything; 0: nothing is known."""
    try:
        content = (run / LIVE_FILE).read_bytes()
    except OSError:
        return 0
    places = (place for place, node in enumerate(scenario.transceivers) if node.is_regulated)
    parts = [PHYSICS, RADIO, *(_FIRST_NODE + place for place in places)]
    content = content.ljust((max(parts) + 1) * _NOTE.size, b"\0")
    return min(int(_NOTE.unpack_from(content, part * _NOTE.size)[0]) for part in parts)
