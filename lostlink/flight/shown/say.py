"""A line for people, whoever wrote what is in it."""

from __future__ import annotations

import click

from aps.logs.printable import printable


def say(text: object, *, err: bool = False) -> None:
    """Print a line to stdout, or to stderr; control characters in it are shown as `printable` gives them."""
    click.echo(printable(str(text)), err=err)


def factor_text(factor: float) -> str:
    """A real-time factor with a decimal, or two digits that count of one below 1; 0.083 is not 0."""
    return f"{factor:.2g}" if factor < 0.995 else f"{factor:.1f}"
