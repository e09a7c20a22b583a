"""A model that a scenario chooses by name."""

from __future__ import annotations

from pydantic import PrivateAttr

from sitl_configs.settings import Settings


class Variant(Settings):
    """A model chosen by its `model` key. Its fields are its parameters, its methods are the physics."""

    _own_key: tuple[str, str] | None = PrivateAttr(default=None)
    """Of a user's model: `model` or `class`, and its value; see `own`."""
