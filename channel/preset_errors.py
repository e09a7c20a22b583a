"""What is wrong with a tree of keys and values that pydantic refuses, named with file, line and key."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo

from sitl_configs.config_file import lines_of
from sitl_configs.settings import models_in

Tree = dict[str, Any]
WORDS = {
    "float_parsing": "has to be a number",
    "float_type": "has to be a number",
    "int_parsing": "has to be a whole number",
    "int_type": "has to be a whole number",
    "int_from_float": "has to be a whole number",
    "string_type": "has to be text",
    "tuple_type": "has to be a list",
    "bool_type": "has to be true or false",
    "bool_parsing": "has to be true or false",
}
"""What pydantic's kinds of mistakes say, in ours."""


class PresetError(ValueError):
    """A radio that cannot be: `key` is the dotted place, `file` and `line` where it was written if known.

    `mistakes` has this one and what else was found at once; the text has a line for each, `line_told` only this one's.
    """

    def __init__(
        self,
        problem: str,
        *,
        key: str = "",
        file: str | None = None,
        line: int | None = None,
        others: Sequence[PresetError] = (),
    ) -> None:
        place = ":".join(str(part) for part in (file, line) if part is not None)
        self.line_told = ": ".join(part for part in (place, key, problem) if part)
        super().__init__("\n".join([self.line_told, *map(str, others)]))
        self.problem = problem
        self.key = key
        self.file = file
        self.line = line
        self.mistakes: tuple[PresetError, ...] = (self, *others)


def at_once(mistakes: Sequence[PresetError]) -> PresetError:
    """Return one error of several."""
    first, *others = mistakes
    return PresetError(first.problem, key=first.key, file=first.file, line=first.line, others=others)


def mistakes_in(
    error: ValidationError, tree: Tree, model: type[BaseModel], below: tuple[str, ...] = ()
) -> list[tuple[str, str]]:
    """Return the key and problem of each mistake in a tree that was read as a model.

    Args:
        error: what was found wrong with it.
        tree: keys and values.
        model: what it was read as.
        below: the keys that lead to the part of it that was read.
    """
    items = [(key_of((*below, *item["loc"]), tree), item) for item in error.errors(include_url=False)]
    unknown = {key for key, item in items if item["type"] == "extra_forbidden"}
    misspelt = {_meant(key, tree, model) for key in unknown}
    return [
        (key, problem_of(item, key, tree, model))
        for key, item in items
        if not (item["type"] == "missing" and key in misspelt)  # it is there, under another name
        and not (
            item["type"] == "too_short" and len(item["input"]) >= item["ctx"]["min_length"]
        )  # but wrong ones
    ]


def key_of(location: tuple[int | str, ...], tree: object) -> str:
    """Return the dotted key of a validation error, without the model names that pydantic puts between."""
    parts: list[str] = []
    tagged: object = None
    for part in location:
        inside = isinstance(tree, Mapping) and part in tree
        if part == "[key]" and not inside:
            continue
        if isinstance(tree, Mapping) and tree is not tagged and part == tree.get("model"):
            tagged = tree  # a key of that name may come next
            continue
        parts.append(str(part))
        if isinstance(tree, Mapping):
            tree = tree.get(part)
        elif isinstance(tree, list) and isinstance(part, int) and part < len(tree):
            tree = tree[part]
    return ".".join(parts)


def problem_of(error: Mapping[str, Any], key: str, tree: Tree, model: type[BaseModel]) -> str:
    """Return what is wrong with the value of a key of a tree that was read as a model."""
    if error["type"] == "extra_forbidden":
        return _unknown_key(key, tree, model)
    if error["type"] == "missing":
        return "is missing"
    if error["type"] == "union_tag_invalid":
        tag, known = error["ctx"]["tag"], error["ctx"]["expected_tags"]
        close = difflib.get_close_matches(
            tag, [each.strip(" '") for each in known.split(",")], n=1, cutoff=0.5
        )
        hint = f"; did you mean {close[0]}? Allowed:" if close else "; allowed:"
        return f"no model {tag!r}{hint} {known}"
    if error["type"] in {"union_tag_not_found", "model_attributes_type", "model_type", "dict_type"}:
        return _no_mapping(error["input"], key, model)
    if error["type"] == "too_short":
        return f"has to have at least {error['ctx']['min_length']}, and has {error['ctx']['actual_length']}"
    if error["type"] == "too_long":
        return f"has to have at most {error['ctx']['max_length']}, and has {error['ctx']['actual_length']}"
    if error["type"] in {"value_error", "own_model", "refused"}:
        return str(error["msg"]).removeprefix("Value error, ")
    wanted = WORDS.get(error["type"])
    return (
        f"{wanted or error['msg'].replace('Input should be', 'has to be', 1)}, not {_shown(error['input'])}"
    )


def _shown(value: object) -> str:
    """A value as YAML has it."""
    if value is None:
        return "null"
    return str(value).lower() if isinstance(value, bool) else repr(value)


def _no_mapping(value: object, key: str, model: type[BaseModel]) -> str:
    tags = [field.default for each in _models_at(key.split("."), {}, model) if (field := _tag_of(each))]
    if not tags:
        return f"has to be a mapping of keys to values, not {_shown(value)}"
    if isinstance(value, Mapping):
        return f"model is missing: has to be one of {', '.join(tags)}"
    if value in tags:
        return f"has to be a mapping, as {{model: {value}}}, not {value!r}"
    return f"has to be a mapping with model, one of {', '.join(tags)}, not {_shown(value)}"


def _tag_of(model: type[BaseModel]) -> FieldInfo | None:
    return model.model_fields.get("model")


def _models_at(groups: Sequence[str], tree: Tree, model: type[BaseModel]) -> list[type[BaseModel]]:
    """The models that a group of keys may be; of several, that which the tree has chosen."""
    models: list[type[BaseModel]] = [model]
    here: Any = tree
    for group in (part for part in groups if not part.isdigit()):
        inner = [
            m
            for model in models
            if group in model.model_fields
            for m in models_in(model.model_fields[group].annotation)
        ]
        here = here.get(group) if isinstance(here, Mapping) else None
        chosen = here.get("model") if isinstance(here, Mapping) else None
        models = [m for m in inner if chosen is None or (tag := _tag_of(m)) is None or tag.default == chosen]
    return models


def _unknown_key(key: str, tree: Tree, model: type[BaseModel]) -> str:
    names, near = ", ".join(_names_beside(key, tree, model)), _meant(key, tree, model).rpartition(".")[2]
    return f"unknown key; did you mean {near}? Allowed: {names}" if near else f"unknown key; allowed: {names}"


def _meant(key: str, tree: Tree, model: type[BaseModel]) -> str:
    """The key that an unknown one is near to; empty: none."""
    group, dot, word = key.rpartition(".")
    close = difflib.get_close_matches(word, _names_beside(key, tree, model), n=1)
    return f"{group}{dot}{close[0]}" if close else ""


def _names_beside(key: str, tree: Tree, model: type[BaseModel]) -> list[str]:
    """The keys that are allowed where a key stands."""
    models = _models_at(key.split(".")[:-1], tree, model)
    return sorted({field.alias or name for model in models for name, field in model.model_fields.items()})


def line_of(file: Path, key: str) -> int | None:
    """Return the line on which the deepest part of a dotted key stands in a YAML file."""
    lines = _lines_of(file, key)
    return lines[-1] if lines else None


def has_key(file: Path, key: str) -> bool:
    """Return whether a dotted key stands in a YAML file."""
    return len(_lines_of(file, key)) == len(key.split("."))


def _lines_of(file: Path, key: str) -> list[int]:
    return lines_of(file.read_text(encoding="utf-8"), key.split("."))
