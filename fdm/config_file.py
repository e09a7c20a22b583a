"""YAML files, and where in one a mistake is."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import yaml
from pydantic import ValidationError
from pydantic_core import ErrorDetails

_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


def read_yaml(text: str) -> Any:
    """What a YAML file says.

    Raises:
        YAMLError: in the words of the slower loader, which has more of them.
    """
    try:
        return yaml.load(text, Loader=_LOADER)
    except yaml.YAMLError:
        return yaml.safe_load(text)


def unknown(what: str, name: object, known: Iterable[str]) -> str:
    """There is no such thing of a kind: with the name that may have been meant, and the known ones."""
    names = list(known)
    close = difflib.get_close_matches(str(name), names, n=1)
    hint = f"; did you mean {close[0]}? Known are" if close else ": known are"
    return f"{what} {str(name)!r}{hint} {', '.join(names)}; or give the path of a YAML file"


def explain(path: Path, text: str, error: ValidationError, allowed: Iterable[str] = ()) -> str:
    """What is wrong with the YAML `text` of `path`: one line per mistake, with file, line and key.

    Args:
        path: the file.
        text: its content.
        error: what its validation found.
        allowed: keys of its top level, to be named for an unknown one.
    """
    allowed = tuple(allowed)
    lines = []
    for problem in error.errors():
        location = problem["loc"]
        key = ".".join(str(part) for part in location) or "(file)"
        lines.append(
            f"{path}:{line_of(text, location)}: {key}: {_message(problem, allowed if len(location) == 1 else ())}"
        )
    return "\n".join(lines)


def _message(problem: ErrorDetails, allowed: tuple[str, ...]) -> str:
    if problem["type"] == "extra_forbidden":
        return f"unknown key; allowed here: {', '.join(allowed)}" if allowed else "unknown key"
    return f"{problem['msg'].removeprefix('Value error, ')} (got {problem['input']!r})"


def line_of(text: str, location: tuple[int | str, ...]) -> int:
    """Line of the deepest node on the way to `location` that the file has (from 1)."""
    node: Any = yaml.compose(text)
    line = 1
    for part in location:
        if isinstance(node, yaml.MappingNode):
            pairs = {key.value: (key, value) for key, value in node.value}
            if part not in pairs:
                break
            key, node = pairs[part]
            line = key.start_mark.line + 1
        elif isinstance(node, yaml.SequenceNode) and isinstance(part, int) and part < len(node.value):
            node = node.value[part]
            line = node.start_mark.line + 1
        else:
            break
    return line
