"""One program to a node: whoever is attached holds a lock beside the run."""

from __future__ import annotations

import fcntl
import json
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from textwrap import shorten
from typing import Final

TOLD_MAX: Final = 60
"""Characters of a command that somebody else is told."""


class AlreadyAttached(Exception):
    """Another program is attached to the node; the text names it."""


@contextmanager
def claimed(run: Path, title: str, node: str, command: Sequence[str]) -> Iterator[None]:
    """Hold a node of a run; the lock ends with this process, in whatever way.

    Args:
        run: directory of the run.
        title: what the node is called where people read.
        node: its id.
        command: what is attached, for whoever comes second.

    Raises:
        AlreadyAttached: another program is attached there.
        OSError: the lock cannot be made.
    """
    path = run / f"attached-{node}.lock"
    fd = _locked(path)
    if fd is None:
        raise AlreadyAttached(f"{title} has a program attached already: {_who(path)}; one at a time")
    try:
        os.ftruncate(fd, 0)
        os.pwrite(fd, json.dumps({"pid": os.getpid(), "command": list(command)}).encode(), 0)
        yield
    finally:
        path.unlink(missing_ok=True)
        os.close(fd)


def _locked(path: Path) -> int | None:
    """The locked file, which is still the one at ``path``; None if somebody else has it."""
    while True:
        fd = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        try:
            fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(fd)
            return None
        if os.fstat(fd).st_nlink:
            return fd
        os.close(fd)  # whoever had it has just removed it


def _who(path: Path) -> str:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        told = shorten(" ".join(content["command"]), TOLD_MAX, placeholder=" ...")
        return f"{told} (process {content['pid']})"
    except (OSError, ValueError, KeyError, TypeError):
        return "of which nothing is known yet"
