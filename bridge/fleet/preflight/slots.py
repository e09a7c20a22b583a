"""Port slots that runs on one machine share without meeting.

Each is held by a lock, which the kernel lets go with its holder, however that ends.
"""

from __future__ import annotations

import fcntl
import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from bridge.fleet.preflight.ports import conflicts, ports_of
from bridge.scenario.file import with_changes
from bridge.scenario.model import Scenario

FIRST_SLOT, LAST_SLOT = 20, 249
"""Slots given out: below are those that people choose."""


class NoSlot(RuntimeError):
    """Too many runs at once on this machine."""


@contextmanager
def lease(count: int, is_usable: Callable[[int], bool] = lambda _: True) -> Iterator[int]:
    """Hold ``count`` slots in a row, and give the first.

    Args:
        count: how many, one per UA.
        is_usable: asked of the first of a row that nobody holds: whether its ports are free, too.

    Raises:
        NoSlot: there is no such row.
        OSError: the locks cannot be kept (in the system's folder for temporary files).
    """
    folder = _folder()
    for first in range(FIRST_SLOT, LAST_SLOT - count + 2):
        with ExitStack() as held:
            if all(
                _hold(folder / f"slot-{slot}", held) for slot in range(first, first + count)
            ) and is_usable(first):
                yield first
                return
    raise NoSlot(f"no {count} port slots in a row are free between {FIRST_SLOT} and {LAST_SLOT}")


def _folder() -> Path:
    folder = Path(tempfile.gettempdir()) / f"lostlink-{os.getuid()}"
    folder.mkdir(mode=0o700, exist_ok=True)
    return folder


def _hold(path: Path, held: ExitStack) -> bool:
    """Lock the file; False if another holds it."""
    fd = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    held.callback(os.close, fd)
    try:
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


@contextmanager
def at_free_ports(scenario: Scenario) -> Iterator[Scenario]:
    """The scenario at slots that no other run has, and any free port for Zenoh, for as long as the context lasts.

    Raises:
        NoSlot, OSError: as `lease`.
    """

    def at_slot(slot: int) -> Scenario:
        return with_changes(scenario, {"ports.first_slot": slot, "ports.zenoh": 0})

    count = max((ua.id for ua in scenario.ua), default=0) + 1
    with lease(count, lambda slot: not conflicts(ports_of(at_slot(slot)))) as slot:
        yield at_slot(slot)
