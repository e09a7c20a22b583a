"""What commands of this package share: how a radio is chosen, and how a mistake of the user ends."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from math import isfinite
from pathlib import Path
from typing import Any

import click

from channel import presets
from channel.config import RadioConfig


class BadInput(click.ClickException):
    """A mistake of the user: one line, exit code 2."""

    exit_code = 2


class FiniteNumber(click.ParamType[float]):
    """A number; nan and inf are none."""

    name = "float"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Of a text, or of a default."""
        number = click.FLOAT.convert(value, param, ctx)
        if not isfinite(number):
            self.fail(f"{value!r} is not a finite number.", param, ctx)
        return number


FINITE = FiniteNumber()


def radio_options(command: Callable[..., None]) -> Callable[..., None]:
    """Add --radio and --set to a command."""
    return click.option(
        "--radio", default="hata-qpsk", show_default=True, help="A preset's name, or a YAML file."
    )(_set_option(command))


def base_radio_options(command: Callable[..., None]) -> Callable[..., None]:
    """Add a --radio that has no default, and --set, to a command that changes a radio."""
    return click.option("--radio", help="The radio to start from: a preset's name, or a YAML file.")(
        _set_option(command)
    )


def chosen_radio(radio: str, settings: tuple[str, ...]) -> RadioConfig:
    """Return the radio that the options name.

    Raises:
        BadInput: no such radio, key or value.
    """
    try:
        return presets.load_radio(radio, presets.overrides_from_settings(settings))
    except presets.PresetError as error:
        raise BadInput(str(error)) from error


def _set_option(command: Callable[..., None]) -> Callable[..., None]:
    return click.option(
        "--set",
        "settings",
        multiple=True,
        metavar="KEY=VALUE",
        help="Override a key of the radio, as in --set propagation.exponent=2.5. Repeatable.",
    )(command)


@contextmanager
def writing(file: Path) -> Iterator[None]:
    """Turn what keeps a file from being written into a mistake of the user.

    Raises:
        BadInput: no such directory, no room, no right; or a plot of a kind that cannot be drawn.
    """
    try:
        yield
    except OSError as error:
        raise BadInput(f"cannot write {error.filename or file}: {error.strerror}") from error
    except ValueError as error:
        raise BadInput(f"cannot write {file}: {error}") from error
