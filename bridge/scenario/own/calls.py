"""What the methods of an agent are called with, and whether a function takes that."""

from __future__ import annotations

import inspect
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Final

CALLED_WITH: Final[Mapping[str, tuple[str, ...]]] = MappingProxyType(
    {
        "__init__": ("ua", "config", "transmit"),
        "fly": (),
        "on_tick": ("sim_time_ns",),
        "on_packet": ("sender", "channel", "payload", "reception"),
        "on_measurement": ("measurement",),
        "transmit_package": ("sim_time_ns",),
    }
)
"""By method, the names of the arguments, which are positional, after ``self``."""


def wrong_call(signature: inspect.Signature, given: Sequence[str], *before: str) -> str:
    """Why a function cannot be called with the positional arguments ``given``, after ``before``; "": it can."""
    try:
        signature.bind(*before, *given)
    except TypeError as error:
        return f"cannot be called with ({', '.join(given)}), as it is: {error}"
    return ""
