"""A file that is there as a whole, or as it was before."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from glob import escape
from pathlib import Path


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Gives the file to write, which takes the place of ``path`` in the end; nothing is left of it if that fails.

    Other processes may write the same one at the same time: the last one's is there then. What a process that was
    killed has left is removed by the next one. In a directory that others write to, too, the file is ours.

    Raises:
        OSError: it cannot be put there, or somebody else has put there what we cannot remove.
    """
    _remove_left(path)
    partial = path.with_name(f"{path.name}.{os.getpid()}.partial")
    with _locked(partial):
        try:
            yield partial
            partial.replace(path)
        finally:
            partial.unlink(missing_ok=True)


@contextmanager
def _locked(partial: Path) -> Iterator[None]:
    """Make a file anew and lock it; once more if it was taken for one that was left before it was locked."""
    while True:
        partial.unlink(missing_ok=True)
        with partial.open("xb") as lock:
            with suppress(OSError):  # a file system without locks
                fcntl.flock(lock, fcntl.LOCK_EX)
            if partial.exists():
                yield
                return


def _remove_left(path: Path) -> None:
    """Remove what processes have left of ``path`` that were killed as they wrote it: nobody has a lock on it."""
    for left in path.parent.glob(f"{escape(path.name)}.*.partial"):
        if left.suffixes[-2][1:].isdecimal() and left.is_file():
            with suppress(OSError), left.open("r+b") as lock:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                if os.path.samestat(os.fstat(lock.fileno()), left.stat()):  # not a newer one of that name
                    left.unlink()
