"""In which line of its author's code an agent's thread is, and in which an error arose."""

from __future__ import annotations

import os
import sys
import sysconfig
import traceback
from pathlib import Path
from typing import Final

from bridge.scenario.resolve.modules import OURS

_NOT_THEIRS: Final = (
    "<",
    *(f"{Path(__file__).parents[3] / package}{os.sep}" for package in OURS),
    *(sysconfig.get_path(name) for name in ("stdlib", "platstdlib", "purelib", "platlib")),
)
"""What the names of files begin with that are no agent's: Python's, those of installed packages, and ours."""


def whereabouts(thread_id: int | None) -> str:
    """The innermost line of an author's code in a thread, as ``agent.py, line 12 (on_tick)``; "" if there is none."""
    frame = None if thread_id is None else sys._current_frames().get(thread_id)
    if frame is None:
        return ""
    line = _innermost(traceback.extract_stack(frame))
    return "" if line is None else f"{Path(line.filename).name}, line {line.lineno} ({line.name})"


def place_of(error: BaseException | None) -> str:
    """The innermost line of an author's code that an error went through, as ``agent.py:12``; "" if there is none.

    Of a group, as TaskGroup raises it, that of its first one.
    """
    while isinstance(error, BaseExceptionGroup):
        error = error.exceptions[0]
    line = None if error is None else _innermost(traceback.extract_tb(error.__traceback__))
    return "" if line is None else f"{Path(line.filename).name}:{line.lineno}"


def _innermost(lines: traceback.StackSummary) -> traceback.FrameSummary | None:
    return next((line for line in reversed(lines) if not line.filename.startswith(_NOT_THEIRS)), None)
