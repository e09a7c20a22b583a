"""Tells of a radio that is at one tick for long: a user's own router or medium may never come back."""

from __future__ import annotations

import logging
import sys
import threading
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import monotonic
from typing import NamedTuple

from bridge.timeouts import BLOCKED_LOOK_S, BLOCKED_S
from sitl_configs.own_code import innermost, line_in_words

log = logging.getLogger("radio")


class _Work(NamedTuple):
    """A tick that is being settled: since when, by wall time, which, and in which thread."""

    since_s: float
    sim_time_ns: int
    thread_id: int


class SettlingWatch:
    """Looks now and then, in a thread of its own, whether the radio is at a tick for more than `BLOCKED_S`.

    Args:
        tell: called, in that thread, with the tick and a text that has the line of the user's code; once for each tick.
    """

    def __init__(self, tell: Callable[[int, str], object]) -> None:
        self._tell = tell
        self._work: _Work | None = None
        self._over = threading.Event()
        self._thread: threading.Thread | None = None

    @contextmanager
    def at(self, sim_time_ns: int) -> Iterator[None]:
        """The radio settles a tick."""
        if self._thread is None:
            self._thread = threading.Thread(target=self._watch, name="radio's watch", daemon=True)
            self._thread.start()
        self._work = _Work(monotonic(), sim_time_ns, threading.get_ident())
        try:
            yield
        finally:
            self._work = None

    def close(self) -> None:
        """Look no more."""
        self._over.set()
        if self._thread is not None:
            self._thread.join()

    def _watch(self) -> None:
        told: _Work | None = None
        while not self._over.wait(BLOCKED_LOOK_S):
            work = self._work
            if work is not None and work is not told and monotonic() - work.since_s >= BLOCKED_S:
                told = work
                self._look(work)

    def _look(self, work: _Work) -> None:
        frame = sys._current_frames().get(work.thread_id)
        if frame is None or self._work is not work:
            return
        stack = traceback.extract_stack(frame)
        line = innermost(stack)
        where = "" if line is None else f", in {line_in_words(line)}"
        at_s = work.sim_time_ns / 1e9
        text = f"settling the tick at {at_s:.2f} s takes more than {BLOCKED_S:g} s of wall time{where}"
        log.info("the radio's stack:\n%s", "".join(stack.format()).rstrip())
        log.warning("%s", text)
        self._tell(work.sim_time_ns, text)
