"""Options that take a number or one word, such as ``--speed X|max``."""

from __future__ import annotations

from typing import Any

import click


class NumberOrWord(click.ParamType[float | str]):
    """A number, or the one word that stands for another way.

    Args:
        name: as ``--help`` has it.
        word: the word.
        number: what a number is made by; its range is left to the scenario, which knows it.
    """

    def __init__(self, name: str, word: str, number: type[int] | type[float]) -> None:
        self.name, self._word, self._number = name, word, number

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Give the number, or the word."""
        try:
            return value if value == self._word else self._number(value)
        except ValueError:
            kind = "whole number" if self._number is int else "number"
            self.fail(f"{value!r} is neither a {kind} nor {self._word!r}", param, ctx)


SPEED = NumberOrWord("X|max", "max", float)
"""A real-time factor, or max."""
SLOT = NumberOrWord("N|auto", "auto", int)
"""A slot, or auto."""
