"""In which line of its author's code an agent's thread is, and in which an error arose."""

from __future__ import annotations

import os
import sys
import sysconfig
import traceback
from collections.abc import Iterable, Iterator
from pathlib import Path
from types import FrameType
from typing import Final

from bridge.scenario.resolve.modules import OURS

_NOT_THEIRS: Final = (
    "<",
    *(f"{Path(__file__).parents[3] / package}{os.sep}" for package in OURS),
    *(sysconfig.get_path(name) for name in ("stdlib", "platstdlib", "purelib", "platlib")),
)
"""What the names of files begin with that are no agent's: Python's, those of installed packages, and ours."""


def whereabouts(thread_id: int | None, coroutines: Iterable[object] = ()) -> str:
    """The innermost line of an author's code in a thread, as ``agent.py, line 12 (on_tick)``; "" if there is none.

    Args:
        thread_id: of the thread.
        coroutines: looked at one after the other if the thread is in no such line, as between two steps of a task.
    """
    frame = None if thread_id is None else sys._current_frames().get(thread_id)
    stacks = [] if frame is None else [traceback.extract_stack(frame)]
    stacks += [traceback.StackSummary.extract(_awaited_in(each)) for each in coroutines]
    for line in map(_innermost, stacks):
        if line is not None:
            return f"{Path(line.filename).name}, line {line.lineno} ({line.name})"
    return ""


def _awaited_in(coroutine: object) -> Iterator[tuple[FrameType, int]]:
    """Frames and lines of a coroutine that is suspended, and of what it awaits."""
    while coroutine is not None:
        frame = getattr(coroutine, "cr_frame", None) or getattr(coroutine, "gi_frame", None)
        if frame is not None:
            yield frame, frame.f_lineno
        coroutine = getattr(coroutine, "cr_await", None) or getattr(coroutine, "gi_yieldfrom", None)


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
