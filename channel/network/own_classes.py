"""What a medium or a router of a user's own raises in a run, told by its class, file and line."""

from __future__ import annotations

import inspect
import traceback
from collections.abc import Iterator
from contextlib import contextmanager

from channel.access.media.medium import AccessMedium
from channel.checks import ChannelInputError
from channel.own.methods import OwnModelError
from channel.routing.router import HopRouter
from channel.validity import OutsideValidityError
from sitl_configs.own_code import is_own, told


@contextmanager
def told_by_class(medium: AccessMedium, router: HopRouter | None) -> Iterator[None]:
    """Tell what goes wrong while a network lives, if its medium or router is a user's own.

    On a shared clock it may be those of another network, which are named then.

    Raises:
        OwnModelError: one of the user's raised, or what it did cannot be.
    """
    try:
        yield
    except (OwnModelError, ChannelInputError, OutsideValidityError):  # a model says what it does not hold for
        raise
    except Exception as error:
        author = _author(error, (medium, router))
        if author is None:
            raise
        kind = "router" if isinstance(author, HopRouter) else "medium"
        raise OwnModelError(
            f"the {kind} {type(author).__name__}: {told(error, _place(type(author)))}"
        ) from error


def _author(error: Exception, those: tuple[object, ...]) -> object:
    """The user's medium or router in which an error arose, the first of those unless it says; None: there is none."""
    frames = [frame for frame, _ in traceback.walk_tb(error.__traceback__)]
    raising = (frame.f_locals.get("self") for frame in reversed(frames))
    met = (each for each in raising if isinstance(each, AccessMedium | HopRouter))
    return next((each for each in (*met, *those) if each is not None and is_own(type(each))), None)


def _place(found: type) -> str:
    """Where a class is written, for an error that went through no line of it; "" if it is in no file."""
    try:
        return f"{inspect.getsourcefile(found)}:{inspect.getsourcelines(found)[1]}"
    except (OSError, TypeError):
        return ""
