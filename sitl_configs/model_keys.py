"""Which of a file's models a validation error lies in: from pydantic's path to the file's."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, get_args, get_origin

from pydantic import BaseModel

from sitl_configs.settings import models_in

Key = tuple[str | int, ...]
"""Keys and indices, as in the file."""
Models = tuple[type[BaseModel], ...]
TAGS = ("type", "kind", "model")
"""Keys whose word chooses what a mapping is."""
BRANCHES = {"str", "float", "int", "bool", "none"}
"""Steps that pydantic makes of types; others have brackets, or begin with constrained-."""


class ErrorSpot(NamedTuple):
    """Where an error is.

    Attributes:
        path: the key.
        parents: the models that the last key may belong to.
    """

    path: Key
    parents: Models


def spot_of(root: type[BaseModel], loc: Sequence[str | int], *, is_extra: bool = False) -> ErrorSpot:
    """The spot of a validation error of ``root``.

    Pydantic puts the branch that it chose of a union into its path, which is no key of the file: it narrows the models.

    Args:
        root: what was validated.
        loc: pydantic's path.
        is_extra: its last step is a key that no model has, whatever that is called.
    """
    path: list[str | int] = []
    here: Models = (root,)
    parents: Models = here
    names = 0
    for number, step in enumerate(loc, start=1):
        is_key = is_extra and number == len(loc)
        inner = _inner(here, step)
        if names:  # keys of a dict have any name, also that of a type
            path.append(step)
            names -= 1
        elif len(here) > 1 and (branch := _branch(here, step)) is not None:
            here = parents = branch  # also if one of them has a key of that name
        elif isinstance(step, int) and not is_key:
            path.append(step)
        elif inner is not None:
            path.append(step)
            names = max(_dicts(fields_of(model).get(str(step))) for model in here)
            parents, here = here, inner
        elif here and not is_key and (narrowed := _branch(here, step)) is not None:
            here = parents = narrowed
        elif here and (is_key or not _is_branch(step)):
            path.append(step)
            parents, here = here, ()
        elif not here and step != "[key]" and not _is_branch(step):
            path.append(step)
    return ErrorSpot(tuple(path), parents)


def allowed_keys(models: Models) -> list[str]:
    """Keys that a mapping may have, as in the file."""
    return list(dict.fromkeys(name for model in models for name in fields_of(model)))


def fields_of(model: type[BaseModel]) -> dict[str, Any]:
    """Types of a model's fields, by the key that they have in a file."""
    return {field.alias or name: field.annotation for name, field in model.model_fields.items()}


def tags_of(models: Models, key: str) -> list[str]:
    """The words by which one of several models is chosen."""
    return [tag for model in models for tag in _literals(fields_of(model).get(key))]


def tag_key(models: Models) -> str | None:
    """The key that chooses one of several models; None if none does."""
    return next((key for key in TAGS if all(tags_of((model,), key) for model in models)), None)


def _inner(models: Models, step: str | int) -> Models | None:
    """The models below a key; None if it is no key of theirs."""
    having = [
        fields[step] for model in models if isinstance(step, str) and step in (fields := fields_of(model))
    ]
    return tuple(model for annotation in having for model in models_in(annotation)) if having else None


def _dicts(annotation: Any) -> int:
    """How many keys of any name lead to a value."""
    return 1 + _dicts(get_args(annotation)[1]) if get_origin(annotation) is dict else 0


def _branch(models: Models, step: str | int) -> Models | None:
    found = tuple(model for model in models if step == model.__name__ or step in _own_tags(model))
    return found or None


def _own_tags(model: type[BaseModel]) -> list[str]:
    return [tag for key in TAGS for tag in _literals(fields_of(model).get(key))]


def _literals(annotation: Any) -> list[str]:
    return [word for word in get_args(annotation) if isinstance(word, str)]


def _is_branch(step: str | int) -> bool:
    """Whether pydantic made the step of a type."""
    return isinstance(step, str) and (step in BRANCHES or step.startswith("constrained-") or "[" in step)
