"""A line for people, whoever wrote what is in it."""

from __future__ import annotations

import click

from aps.logs.printable import printable

__all__ = ["say"]


def say(text: object, *, err: bool = False) -> None:
    """Print a line to stdout, or to stderr; control characters in it are shown as `printable` gives them."""
    click.echo(printable(str(text)), err=err)
