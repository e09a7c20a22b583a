"""A file that is there as a whole, or as it was before."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def whole_file(path: Path, *, is_shared: bool = False) -> Iterator[Path]:
    """Gives the file to write, which takes the place of ``path`` in the end; nothing is left of it if that fails.

    Args:
        path: of the whole file.
        is_shared: other processes may write it at the same time.

    Raises:
        OSError: it cannot be put there.
    """
    own = f".{os.getpid()}" if is_shared else ""
    partial = path.with_name(f"{path.name}{own}.partial")
    make_new(partial)
    try:
        yield partial
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def make_new(path: Path) -> None:
    """Make an empty file in the place of what has its name: in a directory that others write to, too, it is ours.

    Raises:
        OSError: it cannot be made, or somebody else has put there what we cannot remove.
    """
    path.unlink(missing_ok=True)
    os.close(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666))
