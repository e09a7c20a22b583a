"""The base of everything that a scenario chooses by name: frozen, validated, unknown keys refused."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, PrivateAttr


class Variant(BaseModel):
    """A model chosen by its `model` key. Its fields are its parameters, its methods are the physics."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)
    _own_key: tuple[str, str] | None = PrivateAttr(default=None)
    """Of a user's model: `model` or `class`, and its value; see `own`."""


class Settings(BaseModel):
    """A group of keys with no choice of model."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)
