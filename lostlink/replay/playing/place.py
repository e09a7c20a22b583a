"""Where a record that is played can be found and joined: a directory as a run has while it goes on, gone at the end."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from bridge.bus.identity.keyring import Keyring
from bridge.bus.identity.roster import roster
from bridge.bus.keys import checked_chunk
from bridge.bus.session import free_port
from bridge.run.directory import SECRETS_FOLDER, RunDirectory, new_directory
from bridge.scenario.model import Scenario

HOST = "127.0.0.1"
PREFIX = "replay-"


@contextmanager
def playing_place(parent: Path, name: str, scenario: Scenario, port: int) -> Iterator[RunDirectory]:
    """A directory in ``parent`` that `lostlink echo` and `lostlink token` find.

    Args:
        parent: where runs are kept.
        name: of the directory, and in all keys; a number is added if it is there already.
        scenario: of the record.
        port: of the router; 0: any free one.

    Raises:
        ValueError: the name cannot be part of a key.
        OSError: it cannot be made.
    """
    path = new_directory(parent, checked_chunk(name))
    try:
        nodes = scenario.stations
        keyring = Keyring.create(path / SECRETS_FOLDER, roster(nodes, {}, ()))
        try:
            place = RunDirectory(path.resolve())
            place.write(scenario, f"tcp/{HOST}:{port or free_port()}", keyring=keyring)
            with place.going_on():
                yield place
        finally:
            keyring.remove()
    finally:
        shutil.rmtree(path)
