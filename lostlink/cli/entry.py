"""Where the command `lostlink` begins: an interruption ends it with a line, also while it loads."""

from __future__ import annotations

import codecs
import io
import os
import signal
import sys

from bridge.fleet.children.environment import of_runs
from bridge.run.garbage import look_rarely
from lostlink.flight.signals import ending_signals, heed_signals, hold_signals, leave_terminal

FLYING = ("run", "refly")
PLAIN = {"\u202f": " ", "\u2013": "-", "\u2019": "'", "\u2026": "..."}
"""Of the characters that we print, those that not every terminal has."""


def main() -> None:
    """Run the command. One that flies replaces the way it ends by its own, orderly one."""
    look_rarely()
    _open_what_is_closed()
    _print_all()
    _print_what_it_can()
    for number in ending_signals():
        signal.signal(number, _end)
    heed_signals()
    if _flies() and sys.platform == "linux" and "PYTHONHASHSEED" not in os.environ:
        _begin_anew()
    from lostlink.cli.main import main as command

    command()


def _flies() -> bool:
    return sys.argv[1:2] != [] and sys.argv[1] in FLYING


def _open_what_is_closed() -> None:
    """Have the standard files lead nowhere where they are closed: what is opened next would be taken for them."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)


def _print_all() -> None:
    """Print through a buffer: without one (PYTHONUNBUFFERED) Python drops what a full disk does not take, unsaid."""
    stream = sys.stdout
    if isinstance(stream, io.TextIOWrapper) and isinstance(stream.buffer, io.RawIOBase):
        raw = io.FileIO(stream.fileno(), "w", closefd=False)
        sys.stdout = sys.__stdout__ = io.TextIOWrapper(  # type: ignore[misc]
            io.BufferedWriter(raw), stream.encoding, stream.errors, line_buffering=True
        )


def _print_what_it_can() -> None:
    """Have a terminal that lacks a character show it in others: a name must not end a command."""
    codecs.register_error(__name__, _in_others)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper) and stream.errors == "strict":
            stream.reconfigure(errors=__name__)


def _in_others(error: UnicodeError) -> tuple[str, int]:
    """Give what is printed in the place of characters that cannot be."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    text = error.object[error.start : error.end]
    return "".join(PLAIN.get(each) or ascii(each)[1:-1] for each in text), error.end


def _begin_anew() -> None:
    """Begin again in the environment of a run: so its program can be forked from this process, and need not load.

    Where that cannot be, its program is started anew.
    """
    hold_signals()
    words, environment = ["-P", *sys.orig_argv[1:]], {**os.environ, **of_runs(os.environ)}
    try:
        os.execve(sys.executable or "", [sys.executable, *words], environment)
    except OSError:
        heed_signals()


def _end(number: int, _: object) -> None:
    """End at once: whatever is being imported could swallow an exception."""
    when = " before the run began" if _flies() else ""
    leave_terminal()
    os.write(2, f"lostlink: interrupted{when}\n".encode())
    os._exit(128 + number)


if __name__ == "__main__":
    main()
