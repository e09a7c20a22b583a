"""From what pydantic found wrong to words for people: which key, and what would be right."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Any, Final

from pydantic import BaseModel, ValidationError

from sitl_configs.model_keys import ErrorSpot, Key, allowed_keys, fields_of, spot_of, tag_key, tags_of
from sitl_configs.near import meant, near_miss
from sitl_configs.settings import models_in

NO_EXAMPLES: Final[Mapping[str, str]] = MappingProxyType({})
UNKNOWN = ("extra_forbidden", "invalid_key")
"""What pydantic calls a key that is not there, and one that is no text."""
WORDS = {
    r"^[A-Za-z0-9][A-Za-z0-9_.-]*$": "letters, digits, '_', '.' and '-', the first a letter or digit",
    r"^.+:[^\s:]+$": "FILE.py:NAME or package.module:NAME",
    r"^[A-Z][A-Z0-9_]{0,15}$": "a parameter's name: up to 16 capital letters, digits and '_'",
}
"""What patterns of the models say."""
WANTED = re.compile(r"has to be (.*) \(got (.*)\)(.*)", re.DOTALL)
TYPES = {
    "string": "text",
    "float": "a number",
    "int": "a whole number",
    "bool": "true or false",
    "list": "a list",
    "tuple": "a list",
    "dict": "a mapping of keys to values",
    "model": "a mapping of keys to values",
    "model_attributes": "a mapping of keys to values",
}
SCALARS = ("string", "float", "int", "bool")
_BEGINS = {"Value error, ": "", "Input should be ": "has to be ", "Input should have ": "has to have "}


def mistakes_in(
    error: ValidationError, model: type[BaseModel], examples: Mapping[str, str] = NO_EXAMPLES
) -> Iterator[tuple[Key, str]]:
    """The key and the problem of each mistake.

    Args:
        error: what was found wrong.
        model: what was validated.
        examples: what keys could be, as ``id: 0``, by their names.
    """
    items = [
        (item, spot_of(model, item["loc"], is_extra=item["type"] in UNKNOWN))
        for item in error.errors(include_url=False)
    ]
    misspelt = {
        (*spot.path[:-1], meant(str(spot.path[-1]), allowed_keys(spot.parents)))
        for item, spot in items
        if item["type"] in UNKNOWN
    }
    texts: dict[Key, list[str]] = {}
    for item, spot in items:
        if item["type"] == "too_short" and len(item["input"]) >= item["ctx"]["min_length"]:
            continue  # there are enough, but wrong ones, which have lines of their own
        if item["type"] == "missing" and spot.path in misspelt:
            continue  # it is there, under another name
        path = (*spot.path, _discriminator(item)) if item["type"] == "union_tag_invalid" else spot.path
        texts.setdefault(path, []).append(_problem(item, spot, examples))
    for path, several in texts.items():
        for text in dict.fromkeys(_in_one(several)):
            yield path, text


def _in_one(texts: list[str]) -> list[str]:
    """What a value of several kinds may be, each with a text of its own, in one text."""
    found = [WANTED.fullmatch(text) for text in texts]
    parts = [match.groups() for match in found if match is not None]
    if len(parts) < max(2, len(texts)) or len({got for _, got, _ in parts}) > 1:
        return texts
    hints = "".join(dict.fromkeys(hint for *_, hint in parts))
    return [
        f"has to be {' or '.join(dict.fromkeys(wanted for wanted, *_ in parts))} (got {parts[0][1]}){hints}"
    ]


def _problem(item: Any, spot: ErrorSpot, examples: Mapping[str, str]) -> str:
    kind, value, key = item["type"], item["input"], spot.path[-1] if spot.path else ""
    example = examples.get(str(key))
    if kind in UNKNOWN:
        return _unknown_key(str(key), spot)
    if kind == "missing" and isinstance(key, int):
        return "is missing: the list has to have more values"
    if kind == "missing":
        return f"is required, and missing{f': add {example}, say' if example else ''}"
    if kind in {"union_tag_not_found", "union_tag_invalid"}:
        return _no_branch(item, spot)
    base, _, ending = kind.rpartition("_")
    if ending in {"type", "parsing"} and base in TYPES:
        keys, sample = _keys_of(value, spot) if base.startswith(("dict", "model")) else ("", None)
        as_in = f", as in {example or sample}" if base not in SCALARS and (example or sample) else ""
        return f"has to be {TYPES[base]}{keys} (got {shown(value)}){as_in}"
    if kind == "int_from_float":
        return f"has to be a whole number (got {shown(value)})"
    if kind == "string_pattern_mismatch":
        pattern = item["ctx"]["pattern"]
        return f"has to be {WORDS.get(pattern, f'text like {pattern}')} (got {shown(value)})"
    if kind == "string_too_long":
        return f"has to have at most {item['ctx']['max_length']} characters (got {shown(value)})"
    if kind == "literal_error":
        words = re.findall(r"'([^']*)'", item["ctx"]["expected"])
        return f"{_sentence(item['msg'])} (got {shown(value)}){near_miss(value, words)}"
    return _sentence(item["msg"]) + (
        f" (got {shown(value)})" if not isinstance(value, dict | list | tuple) else ""
    )


def _unknown_key(word: str, spot: ErrorSpot) -> str:
    allowed = allowed_keys(spot.parents)
    hint, there = near_miss(word, allowed), f"allowed here: {', '.join(allowed)}"
    return f"unknown key{hint} ({there})" if hint else f"unknown key; {there}"


def _no_branch(item: Any, spot: ErrorSpot) -> str:
    """What the word may be by which one of several models is chosen."""
    key = _discriminator(item)
    words = tags_of(_branches(spot), key)
    if item["type"] == "union_tag_not_found":
        return f"{key} is missing: has to be one of: {', '.join(words)}"
    value = item["input"][key]
    return f"has to be one of: {', '.join(words)} (got {shown(value)}){near_miss(value, words)}"


def _discriminator(item: Any) -> str:
    """The key whose word chooses what a mapping is."""
    return str(item["ctx"]["discriminator"]).strip("'")


def _branches(spot: ErrorSpot) -> tuple[type[BaseModel], ...]:
    key = next((step for step in reversed(spot.path) if isinstance(step, str)), "")
    found = [fields_of(model).get(key) for model in spot.parents]
    return tuple(model for annotation in found for model in models_in(annotation))


def _keys_of(value: object, spot: ErrorSpot) -> tuple[str, str | None]:
    """What the keys of a mapping are, or the one by which it is chosen; and how a value that is its word is written."""
    branches = _branches(spot) if spot.path else ()
    if len(branches) > 1 and (tag := tag_key(branches)):
        words = tags_of(branches, tag)
        sample = f"{spot.path[-1]}: {{{tag}: {value}}}" if value in words else None
        return f" with {tag}, one of: {', '.join(words)}", sample
    keys = allowed_keys(branches)
    return f", with {', '.join(keys)}" if keys else "", None


def _sentence(text: str) -> str:
    """Pydantic's words in ours."""
    text = re.sub(
        r"^(Value error, |Input should be |Input should have )", lambda m: _BEGINS[m.group(1)], text
    )
    text = text.replace("Tuple should have", "has to have").replace("List should have", "has to have")
    return text.replace(" after validation", "")


def shown(value: object) -> str:
    """A value as YAML has it, cut off where it is long."""
    text = "null" if value is None else str(value).lower() if isinstance(value, bool) else repr(value)
    return text if len(text) <= 80 else f"{text[:77]}..."
