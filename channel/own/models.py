"""Models that are not part of this package: registered by entry point, or named as `class: file.py:Name`.

An entry point of a group gives a class the name under which `model` finds it: `lostlink.propagation`, `.shadowing`,
`.fading`, `.noise`, `.bursts`, `.error`, `.antenna`, `.medium` and `.routing`. `class` names one in a file, or in a
module that can be imported, without installing anything.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib.metadata import entry_points
from pathlib import Path
from types import MappingProxyType, ModuleType
from typing import Any, Final, get_args

from pydantic import ValidationError, WrapSerializer, WrapValidator
from pydantic.fields import FieldInfo
from pydantic_core import InitErrorDetails, PydanticCustomError

from channel.own.methods import Method, OwnModelError, looked_at, tried
from channel.variant import Variant
from sitl_configs.mistakes import mistakes_in
from sitl_configs.own_code import load_module, told

CLASS_KEY = "class"
NO_METHODS: Final[Mapping[str, Method]] = MappingProxyType({})
_KNOWN: dict[tuple[type[Variant], str, str], type[Variant]] = {}
"""Classes whose methods are looked at, by what they are made of."""


@dataclass(frozen=True, slots=True)
class OwnModels:
    """In the annotation of a field: that it takes a user's models, by the group of their entry points."""

    group: str


def own_models(
    group: str,
    *needed: str,
    base: type[Variant] = Variant,
    methods: Mapping[str, Method] = NO_METHODS,
    trial: Callable[[Any, str], None] | None = None,
) -> tuple[WrapValidator, WrapSerializer, OwnModels]:
    """Return what lets a field of a radio take a user's model beside those of its union.

    Args:
        group: of entry points, without `lostlink.`.
        needed: methods and properties that the model has to have.
        base: of such models; one that is not derived from it gets what it lacks.
        methods: what those have to give whose results are looked at.
        trial: tries what else a model, which is called so, has to do; raises OwnModelError if it does not.
    """

    def validate(value: Any, others: Callable[[Any], Any]) -> Any:
        if isinstance(value, Variant) and value._own_key is not None:
            return value
        key, parameters = _asked_for(value, group)
        if key is None:
            return others(value)
        found, label = _class_of(key, group), Path(key[1]).name
        missing = [name for name in needed if not _has(found, name, base)]
        if missing:
            raise ValueError(f"{found.__name__} in {key[1]} has no {', '.join(missing)}")
        try:
            model = _looked_at(found, label, group, base, methods).model_validate(parameters)
            if getattr(model, "is_random", True):
                tried(model, label, methods, trial)
        except ValidationError as error:
            raise _in_our_words(error, found) from None
        except OwnModelError:
            raise
        except (
            Exception
        ) as error:  # its author's validators or properties raise, or it is not defined in full
            raise ValueError(told(error, key[1])) from error
        model._own_key = key
        return model

    def serialize(value: Any, others: Callable[[Any], Any]) -> Any:
        key = value._own_key if isinstance(value, Variant) else None
        if key is None:
            return others(value)
        given = value.model_dump(mode="json", exclude_unset=True)  # a default's path is seen from its file
        return dict([key]) | {name: item for name, item in given.items() if name != "model"}

    return WrapValidator(validate), WrapSerializer(serialize), OwnModels(group)


def takes_own(field: FieldInfo) -> bool:
    """Return whether a field takes a user's model."""
    below = [each for part in get_args(field.annotation) for each in getattr(part, "__metadata__", ())]
    return any(isinstance(each, OwnModels) for each in (*field.metadata, *below))


def _has(found: type[Variant], name: str, base: type[Variant]) -> bool:
    """Whether a model has something, other than its base, which says only what it is."""
    of_base = getattr(base, name, None)
    return name in found.model_fields or getattr(found, name, of_base) is not of_base


def _looked_at(
    found: type[Variant], label: str, group: str, base: type[Variant], methods: Mapping[str, Method]
) -> type[Variant]:
    key = found, label, group
    if key not in _KNOWN:
        _KNOWN[key] = looked_at(found, label, base, methods)
    return _KNOWN[key]


def class_path(text: str, folder: Path) -> str:
    """Return `file.py:Name`, as seen from a folder, with the file's absolute path; other texts as they are."""
    file, colon, name = text.rpartition(":")
    return f"{(folder / file).absolute()}:{name}" if colon and file.endswith(".py") else text


def _asked_for(value: Any, group: str) -> tuple[tuple[str, str] | None, dict[str, Any]]:
    """Return the key of a user's model, None if it is one of ours; and the model's parameters."""
    if not isinstance(value, dict):
        return None, {}
    for name in (CLASS_KEY, "model"):
        text = value.get(name)
        if isinstance(text, str) and (name == CLASS_KEY or text in _entry_points(group)):
            return (name, text), {key: item for key, item in value.items() if key != name}
    return None, {}


def _class_of(key: tuple[str, str], group: str) -> type[Variant]:
    name, text = key
    if name == CLASS_KEY:
        found = _from_text(text)
    else:
        point = _entry_points(group)[text]
        found = _from_text(f"{point.module}:{point.attr}")
    if not (isinstance(found, type) and issubclass(found, Variant)):
        raise ValueError(f"{text} is no subclass of channel.variant.Variant")
    return found


@lru_cache(maxsize=8)
def _entry_points(group: str) -> Any:
    return {each.name: each for each in _all_entry_points().select(group=f"lostlink.{group}")}


@cache
def _all_entry_points() -> Any:
    """What is installed, looked through once for all groups."""
    return entry_points()


def _from_text(text: str) -> object:
    place, colon, name = text.rpartition(":")
    if not colon or not name.isidentifier():
        raise ValueError(f"{text!r} is not file.py:Name or module:Name")
    path = Path(place).absolute()
    module = (
        _loaded(path, path.stat().st_mtime_ns if path.is_file() else 0)
        if place.endswith(".py")
        else load_module(place)
    )
    if not hasattr(module, name):
        raise ValueError(f"{place} has no class {name}")
    return getattr(module, name)


@lru_cache(maxsize=64)
def _loaded(path: Path, changed_ns: int) -> ModuleType:
    """Return the module of a file, the same until the file changes."""
    digest = hashlib.blake2b(f"{path} {changed_ns}".encode(), digest_size=6).hexdigest()
    return load_module(str(path), f"{path.stem}__{digest}")


def _in_our_words(error: ValidationError, found: type[Variant]) -> ValidationError:
    """Return what is wrong with a user's model, by key, so that it needs no knowledge of that model to be told."""
    told = [
        InitErrorDetails(
            type=PydanticCustomError("own_model", "{message}", {"message": message}), loc=key, input={}
        )
        for key, message in mistakes_in(error, found)
    ]
    return ValidationError.from_exception_data(found.__name__, told)
