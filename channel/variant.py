"""A model that a scenario chooses by name."""

from __future__ import annotations

from pathlib import Path

from pydantic import PrivateAttr

from sitl_configs.settings import Settings


class Variant(Settings):
    """A model chosen by its `model` key. Its fields are its parameters, its methods are the physics."""

    _own_key: tuple[str, str] | None = PrivateAttr(default=None)
    """Of a user's model: `model` or `class`, and its value; see `own`."""

    def __eq__(self, other: object) -> bool:
        """Whether it is the same model with the same parameters, whatever it keeps beside them."""
        if type(self) is not type(other) or not isinstance(other, Variant) or self._own_key != other._own_key:
            return False
        mine, its = ([getattr(model, name) for name in type(self).model_fields] for model in (self, other))
        return mine == its  # of lists, in which the nan of a default equals itself


def name_of(model: Variant) -> str:
    """Return what a model is called: by its `model` key, or of a user's own by its class."""
    return str(getattr(model, "model", type(model).__name__))


def called(model: Variant) -> str:
    """Return the same, of a user's own with its file."""
    return name_of(model) if model._own_key is None else Path(model._own_key[1]).name
