"""In which line of its author's code an agent's thread is, and in which an error arose."""

from __future__ import annotations

import sys
import traceback
from collections.abc import Iterable, Iterator
from pathlib import Path
from types import FrameType

from sitl_configs.own_code import innermost, line_in_words


def whereabouts(thread_id: int | None, coroutines: Iterable[object] = ()) -> str:
    """The innermost line of an author's code in a thread, as ``agent.py, line 12 (on_tick)``; "" if there is none.

    Args:
        thread_id: of the thread.
        coroutines: looked at one after the other if the thread is in no such line, as between two steps of a task.
    """
    frame = None if thread_id is None else sys._current_frames().get(thread_id)
    stacks = [] if frame is None else [traceback.extract_stack(frame)]
    stacks += [traceback.StackSummary.extract(_awaited_in(each)) for each in coroutines]
    for line in map(innermost, stacks):
        if line is not None:
            return line_in_words(line)
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
    line = None if error is None else innermost(traceback.extract_tb(error.__traceback__))
    return "" if line is None else f"{Path(line.filename).name}:{line.lineno}"
