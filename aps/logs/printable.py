"""What others wrote, for a terminal or a log: control characters in it move no cursor and hide no line."""

from __future__ import annotations

import logging
import re
from typing import Final

_CONTROLS: Final = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]"
)
"""All but tab and line feed, what turns the direction of writing, and halves of letters, which no terminal takes."""


def printable(text: str) -> str:
    r"""The text with its control characters as Python writes them, such as ``\x1b``; tabs and line feeds stay."""
    return _CONTROLS.sub(lambda found: repr(found[0])[1:-1], text)


class PrintableForm(logging.Formatter):
    """Lines of a log as `printable` gives them."""

    def format(self, record: logging.LogRecord) -> str:
        """The line, with its traceback if it has one."""
        return printable(super().format(record))
