"""What the parts of a scenario are made of."""

from __future__ import annotations

from typing import Annotated, Any
from unicodedata import normalize

from pydantic import AfterValidator, BeforeValidator, ConfigDict, Field, WithJsonSchema

from sitl_configs.settings import Settings, id_as_text

Latitude = Annotated[float, Field(ge=-90, le=90, allow_inf_nan=False)]
Longitude = Annotated[float, Field(ge=-180, le=180, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Metres = Annotated[float, Field(ge=-1e6, le=1e6, allow_inf_nan=False)]
"""A place in the fleet's frame, which is flat: a thousand kilometres are more than it is good for."""
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Port = Annotated[int, Field(strict=True, ge=0, le=65535)]
Parameters = dict[Annotated[str, Field(pattern=r"^[A-Z][A-Z0-9_]{0,15}$")], Finite]
"""Parameters of an autopilot; MAVLink gives their names 16 characters."""
_PLACED_NAME = r"^.+:[^\s:]+$"


def _placed_name(text: str) -> str:
    place, _, name = text.rpartition(":")
    if not name.isidentifier():
        raise ValueError(f"has to be FILE.py:NAME or package.module:NAME, and {name!r} is no name in Python")
    return f"{place}:{normalize('NFKC', name)}"  # as Python reads it in the file


PlacedName = Annotated[str, Field(pattern=_PLACED_NAME), AfterValidator(_placed_name)]
"""A class or function, by its file or module and its name there."""
Slug = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$", max_length=64)]
"""A name; names become parts of names of files, which systems bound."""

NodeId = Annotated[
    str,
    BeforeValidator(id_as_text),
    WithJsonSchema({"type": ["string", "integer"]}),
]
"""As other parts of a scenario name a node, whose id may be written as a number."""
RESERVED_ID = "all"
"""Of packets for every node (`bridge.bus.keys.ALL`); no node is called so."""


def _radio(value: object) -> object:
    if isinstance(value, str | dict):
        return value
    raise ValueError(
        "has to be the name of a radio preset, or a mapping with 'preset' and what differs from it"
    )


RadioSetting = Annotated[str | dict[str, Any], BeforeValidator(_radio)]
"""A radio preset's name, a file, or a mapping."""


def _wind(value: object) -> object:
    if isinstance(value, str | dict):
        return value
    raise ValueError("has to be the name of a wind, a YAML file, or a mapping with the keys of a wind's file")


WindSetting = Annotated[str | dict[str, Any], BeforeValidator(_wind)]
"""A wind's name, a file, or a mapping."""


class Part(Settings):
    """Part of a scenario: infinity is a number where no bound is said."""

    model_config = ConfigDict(allow_inf_nan=True)
