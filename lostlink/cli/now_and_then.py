"""Lines of a command that takes long: it is seen to go on."""

from __future__ import annotations

from collections.abc import Callable

from bridge.run.every import Every
from bridge.timeouts import NEWS_PERIOD_S
from lostlink.flight.shown.say import say


class NowAndThen:
    """Says on stderr how far something is, when two seconds have passed without a line.

    Args:
        text: the line, from what it is called with.
        silent: whether to say nothing.
        first_s: wall time until the first line; as between others unless given.
    """

    def __init__(
        self, text: Callable[..., str], *, silent: bool = False, first_s: float | None = None
    ) -> None:
        self._text, self._silent = text, silent
        self._news = Every(NEWS_PERIOD_S, first_s)

    def __call__(self, *done: object) -> None:
        """Take how far it is."""
        if not self._silent and self._news.is_due():
            say(self._text(*done), err=True)


def comparing() -> NowAndThen:
    """How far a comparison of two runs is."""
    return NowAndThen("comparing {}: {} entries so far".format)


def reporting() -> NowAndThen:
    """What is done next for a report."""
    return NowAndThen("report: {}".format)
