"""How commands say what is wrong, and end."""

from __future__ import annotations

import sys
from typing import NoReturn

import click

from lostlink.flight.exits import UNUSABLE


def fail(text: object, status: int = UNUSABLE) -> NoReturn:
    """Say what is wrong, each line with the command's name, and end."""
    tell(text)
    sys.exit(status)


def tell(text: object) -> None:
    """Say something on stderr, each line with the command's name."""
    for line in str(text).splitlines():
        click.echo(f"lostlink: {line}", err=True)
