"""One program to a node: whoever is attached holds a lock beside the run."""

from __future__ import annotations

import fcntl
import json
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from textwrap import shorten
from typing import Final

LOCK: Final = "attached-{}.lock"
TOLD_MAX: Final = 60
"""Characters of a command that somebody else is told."""


class AlreadyAttached(Exception):
    """Another program is attached to the node; the text names it."""


@contextmanager
def claimed(run: Path, title: str, node: str, command: Sequence[str], subnet: str) -> Iterator[str]:
    """Hold a node of a run; the lock ends with this process, in whatever way.

    Args:
        run: directory of the run.
        title: what the node is called where people read.
        node: its id.
        command: what is attached, for whoever comes second.
        subnet: of its addresses, likewise.

    Yields:
        Which nodes have programs on other subnets, with these; "" if none has.

    Raises:
        AlreadyAttached: another program is attached there.
        OSError: the lock cannot be made.
    """
    path = run / LOCK.format(node)
    fd = _locked(path)
    if fd is None:
        raise AlreadyAttached(f"{title} has a program attached already: {_who(path)}; one at a time")
    try:
        os.ftruncate(fd, 0)
        claim = {"pid": os.getpid(), "command": list(command), "subnet": subnet}
        os.pwrite(fd, json.dumps(claim).encode(), 0)
        yield ", ".join(_on_other_subnets(run, subnet))
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


def _on_other_subnets(run: Path, subnet: str) -> Iterator[str]:
    for path in sorted(run.glob(LOCK.format("*"))):
        with suppress(OSError, ValueError, KeyError, TypeError):  # it has just begun, or ended
            claim = json.loads(path.read_text(encoding="utf-8"))
            if claim["subnet"] != subnet and Path(f"/proc/{claim['pid']}").exists():
                yield f"{path.stem.removeprefix(LOCK.partition('{')[0])} ({claim['subnet']})"


def _who(path: Path) -> str:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        told = shorten(" ".join(content["command"]), TOLD_MAX, placeholder=" ...")
        return f"{told} (process {content['pid']})"
    except (OSError, ValueError, KeyError, TypeError):
        return "of which nothing is known yet"
