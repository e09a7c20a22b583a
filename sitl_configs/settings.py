"""The base of what configuration files say: frozen, validated, unknown keys and truths for numbers refused."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any, get_args

from pydantic import BaseModel, ConfigDict, ValidationError, model_validator
from pydantic_core import InitErrorDetails, PydanticCustomError


class Settings(BaseModel):
    """A group of keys."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _numbers_are_no_truths(cls, content: Any) -> Any:
        return _numbers_only(cls, content)


def refused(text: str, *key: str | int) -> ValidationError:
    """What a validator of a whole raises for a mistake at a key of it, which would be told of the whole otherwise.

    Args:
        text: what would be right.
        key: keys and indices from there.
    """
    kind = PydanticCustomError("refused", "{text}", {"text": text})
    return ValidationError.from_exception_data("settings", [InitErrorDetails(type=kind, loc=key, input={})])


def id_as_text(value: object) -> object:
    """The text of an id that is written as a number; anything else as it is."""
    return str(value) if type(value) is int else value


def models_in(annotation: Any) -> tuple[type[BaseModel], ...]:
    """All models that a type is made of."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return (annotation,)
    return tuple(model for part in get_args(annotation) for model in models_in(part))


class _NoNumber:
    """true or false where a number has to be: it would count as 1 or 0, and no number is made of this."""

    def __init__(self, value: bool) -> None:
        self._value = value

    def __repr__(self) -> str:
        return str(self._value).lower()  # as YAML has it


def _numbers_only(model: type[BaseModel], content: Any) -> Any:
    """Return a mapping that a model is to be made of, with what no number may be made of in the place of booleans."""
    if not isinstance(content, Mapping):
        return content
    numbers = _numeric_keys(model)
    return {key: _without_truth(value) if key in numbers else value for key, value in content.items()}


def _without_truth(value: Any) -> Any:
    if isinstance(value, bool):
        return _NoNumber(value)
    if isinstance(value, list | tuple):
        return [_without_truth(each) for each in value]
    return {key: _without_truth(each) for key, each in value.items()} if isinstance(value, dict) else value


@cache
def _numeric_keys(model: type[BaseModel]) -> frozenset[str]:
    """The keys of a model that take numbers, and neither booleans nor models, which look after themselves."""
    return frozenset(
        key
        for name, field in model.model_fields.items()
        if _is_numeric(list(_leaves(field.annotation)))
        for key in (name, field.alias or name)
    )


def _is_numeric(leaves: list[Any]) -> bool:
    is_model = any(isinstance(leaf, type) and issubclass(leaf, BaseModel) for leaf in leaves)
    kinds = [
        leaf if isinstance(leaf, type) else type(leaf) for leaf in leaves
    ]  # words of a Literal by their types
    return not is_model and bool not in kinds and (int in kinds or float in kinds)


def _leaves(annotation: Any) -> Iterator[Any]:
    inner = get_args(annotation)
    if not inner:
        yield annotation
    for each in inner:
        yield from _leaves(each)
