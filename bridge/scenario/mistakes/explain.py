"""From what pydantic found wrong to lines for people: place, key, and what would be right."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

from pydantic import BaseModel, ValidationError

from bridge.scenario.document.written import Path_, Written, WrittenPlace
from bridge.scenario.mistakes.keys import ErrorSpot, allowed_keys, fields_of, spot_of, tags_of
from bridge.scenario.mistakes.near import meant, near_miss
from sitl_configs.settings import models_in

EXTRA = "extra_forbidden"
"""What pydantic calls a key that is not there."""
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
EXAMPLES = {
    "schema": "schema: 1",
    "name": "name: my_flight",
    "duration_s": "duration_s: 300",
    "origin": "origin: {lat_deg: 40.1331, lon_deg: -105.2404, alt_amsl_m: 1690}",
    "radio": "radio: hata-qpsk",
    "nodes": "nodes: [{id: 0, agent: {type: hold, altitude_m: 40}}]",
    "agent": "agent: {type: hold, altitude_m: 40}",
    "type": "type: hold",
    "id": "id: 0",
}
"""What a missing key could be."""


def explained(
    root: Written, error: ValidationError, model: type[BaseModel], below: Path_ = ()
) -> Iterator[str]:
    """One line per mistake.

    Args:
        root: the scenario.
        error: what the validation of a part of it found.
        model: what that part was to be.
        below: where in the scenario the part is.
    """
    told: set[tuple[str, Path_, str]] = set()
    texts: dict[Path_, list[str]] = {}
    places: dict[Path_, str] = {}
    items = [
        (item, spot_of(model, item["loc"], is_extra=item["type"] == EXTRA))
        for item in error.errors(include_url=False)
    ]
    misspelt = {
        (*spot.path[:-1], meant(str(spot.path[-1]), allowed_keys(spot.parents)))
        for item, spot in items
        if item["type"] == EXTRA
    }
    for item, spot in items:
        if item["type"] == "too_short" and len(item["input"]) >= item["ctx"]["min_length"]:
            continue  # there are enough, but wrong ones, which have lines of their own
        if item["type"] == "missing" and spot.path in misspelt:
            continue  # it is there, under another name
        spot = spot._replace(path=(*below, *spot.path))
        places.setdefault(spot.path, str(_place(root, spot.path, item)))
        texts.setdefault(spot.path, []).append(_problem(item, spot))
    for path, place in places.items():
        key = path[2:] if path[:1] == ("nodes",) else path
        for text in _in_one(texts[path]):
            if (place, key, text) not in told:  # nodes of a group share their lines
                told.add((place, key, text))
                yield f"{place}: {root.dotted(path)}: {text}"


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


def _place(root: Written, path: Path_, item: Any) -> WrittenPlace:
    """Where a mistake is: of a key that the scenario lacks, where it could be added; of a wrong word, where that is."""
    if item["type"] == "union_tag_invalid":
        path = (*path, _discriminator(item))
    found = root.at(path)
    if item["type"] == "missing" and found is root:
        return root.end or root.place
    return found.place


def _problem(item: Any, spot: ErrorSpot) -> str:
    kind, value = item["type"], item["input"]
    if kind == EXTRA:
        return _unknown_key(str(spot.path[-1]), spot)
    if kind == "missing" and isinstance(spot.path[-1], int):
        return "is missing: the list has to have more values"
    if kind == "missing":
        return _missing(str(spot.path[-1]))
    if kind in {"union_tag_not_found", "union_tag_invalid"}:
        return _no_branch(item, spot)
    base, _, ending = kind.rpartition("_")
    if ending in {"type", "parsing"} and base in TYPES:
        return f"has to be {TYPES[base]}{_keys_of(base, spot)} (got {shown(value)}){_instead(item, spot)}"
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


def _instead(item: Any, spot: ErrorSpot) -> str:
    """What something of another type could be."""
    key = str(spot.path[-1]) if spot.path else ""
    if key == "id":
        return (
            "; only a node with kind: ground has a word for its id" if isinstance(item["input"], str) else ""
        )
    return f", as in {EXAMPLES[key]}" if key in EXAMPLES else ""


def _missing(key: str) -> str:
    example = f": add {EXAMPLES[key]}, say" if key in EXAMPLES else ""
    return f"is required, and missing{example}"


def _no_branch(item: Any, spot: ErrorSpot) -> str:
    key = _discriminator(item)
    words = tags_of(_branches(spot), key)
    value = item["input"].get(key) if isinstance(item["input"], dict) else None
    if value is None:
        return f"{key} is missing: has to be one of: {', '.join(words)}"
    return f"{key} has to be one of: {', '.join(words)} (got {shown(value)}){near_miss(value, words)}"


def _discriminator(item: Any) -> str:
    """The key whose word chooses what a mapping is."""
    return str(item["ctx"]["discriminator"]).strip("'")


def _branches(spot: ErrorSpot) -> tuple[type[BaseModel], ...]:
    key = next((step for step in reversed(spot.path) if isinstance(step, str)), "")
    found = [fields_of(model).get(key) for model in spot.parents]
    return tuple(model for annotation in found for model in models_in(annotation))


def _keys_of(base: str, spot: ErrorSpot) -> str:
    if not base.startswith(("model", "dict")) or not spot.path:
        return ""
    keys = allowed_keys(_branches(spot))
    return f", with {', '.join(keys)}" if keys else ""


def _sentence(text: str) -> str:
    """Pydantic's words in ours."""
    text = re.sub(
        r"^(Value error, |Input should be |Input should have )", lambda m: _BEGINS[m.group(1)], text
    )
    text = text.replace("Tuple should have", "has to have").replace("List should have", "has to have")
    return text.replace(" after validation", "")


_BEGINS = {"Value error, ": "", "Input should be ": "has to be ", "Input should have ": "has to have "}


def shown(value: object) -> str:
    """A value as YAML has it, cut off where it is long."""
    text = "null" if value is None else str(value).lower() if isinstance(value, bool) else repr(value)
    return text if len(text) <= 80 else f"{text[:77]}..."
