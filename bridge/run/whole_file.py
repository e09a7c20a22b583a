"""A file that is there as a whole, or as it was before."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Gives the file to write, which takes the place of ``path`` in the end; nothing is left of it if that fails.

    Other processes may write the same one at the same time: the last one's is there then.

    Raises:
        OSError: it cannot be put there.
    """
    partial = new_partial(path)
    try:
        yield partial
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def new_partial(path: Path) -> Path:
    """Make an empty file for what is to become ``path``; in a directory that others write to, too, it is ours.

    Raises:
        OSError: it cannot be made, or somebody else has put there what we cannot remove.
    """
    partial = path.with_name(f"{path.name}.{os.getpid()}.partial")
    partial.unlink(missing_ok=True)
    os.close(os.open(partial, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666))
    return partial
