"""How commands say what is wrong, and end."""

from __future__ import annotations

import sys
from typing import NoReturn

from lostlink.flight.exits import UNUSABLE
from lostlink.flight.shown.say import say


def fail(text: object, status: int = UNUSABLE) -> NoReturn:
    """Say what is wrong, each line with the command's name, and end.

    Raises:
        BrokenPipeError: it is what is wrong: nobody reads any more.
    """
    if isinstance(text, BrokenPipeError):
        raise text
    tell(text)
    sys.exit(status)


def tell(text: object) -> None:
    """Say something on stderr, of an error its notes, too, each line with the command's name."""
    for line in "\n".join([str(text), *getattr(text, "__notes__", ())]).splitlines():
        say(f"lostlink: {line}", err=True)
