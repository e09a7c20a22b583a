"""Tells an agent's author of a coroutine that was never awaited: Python's own warning goes to a log that few read.

It is no part of what repeats: a coroutine in a cycle of references is found whenever Python collects it.
"""

from __future__ import annotations

import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

NEVER_AWAITED = "was never awaited"
"""In the text of Python's warning."""
_tells: dict[int, Callable[[str], object]] = {}
"""By the thread of an agent: reports a text."""
_otherwise: Callable[..., Any] | None = None


@contextmanager
def told_of_unawaited(tell: Callable[[str], object]) -> Iterator[None]:
    """Have ``tell`` called with what this thread makes and never awaits, and with its place, once for each place."""
    global _otherwise
    if warnings.showwarning is not _show:
        _otherwise, warnings.showwarning = warnings.showwarning, _show  # type: ignore[assignment]
        # Python tells of a place once in a process: the second agent's would be silent, or whatever is asked for.
        warnings.filterwarnings("always", f".*{NEVER_AWAITED}", RuntimeWarning)
    told: set[str] = set()

    def tell_once(text: str) -> None:
        if text not in told:
            told.add(text)
            tell(text)

    _tells[threading.get_ident()] = tell_once
    try:
        yield
    finally:
        del _tells[threading.get_ident()]


def _show(message: Warning | str, category: type[Warning], filename: str, lineno: int, *more: Any) -> None:
    """In the place of `warnings.showwarning`."""
    tell = _tells.get(threading.get_ident())
    if tell is not None and NEVER_AWAITED in str(message):
        tell(f"{message}: put await before it ({Path(filename).name}, line {lineno})")
    elif _otherwise is not None:
        _otherwise(message, category, filename, lineno, *more)
