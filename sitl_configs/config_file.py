"""YAML files, and where in one a mistake is."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from sitl_configs.settings import models_in
from sitl_configs.yaml_text import YamlMistake, read_yaml, ships

M = TypeVar("M", bound=BaseModel)
WORDS = {
    "float_type": "has to be a number",
    "float_parsing": "has to be a number",
    "int_type": "has to be a whole number",
    "int_parsing": "has to be a whole number",
    "int_from_float": "has to be a whole number",
    "string_type": "has to be text",
    "tuple_type": "has to be a list",
    "dict_type": "has to be a mapping of keys to values",
    "model_type": "has to be a mapping of keys to values",
}
"""What pydantic's kinds of mistakes say, in ours."""


def read_model(path: Path, model: type[M], mistake: type[Exception]) -> M:
    """What a YAML file says.

    Args:
        path: the file.
        model: what its keys and values are to be.
        mistake: what is raised if they are not; the text has a line for each, with file, line and key.
    """
    try:
        text = path.read_text(encoding="utf-8")
        return model.model_validate(read_yaml(text, is_ours=ships(path)))
    except OSError as error:
        raise mistake(f"{path}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise mistake(f"{path}: is not UTF-8 text") from None
    except YamlMistake as error:
        line = "" if error.line is None else f":{error.line}"
        raise mistake(f"{path}{line}: {error}") from None
    except ValidationError as error:
        raise mistake("\n".join(_explained(path, text, error, model))) from None


def unknown(what: str, name: object, known: Iterable[str]) -> str:
    """There is no such thing of a kind: with the name that may have been meant, and the known ones."""
    names = list(known)
    close = difflib.get_close_matches(str(name), names, n=1)
    hint = f"; did you mean {close[0]}? Known are" if close else ": known are"
    return f"{what} {str(name)!r}{hint} {', '.join(names)}; or give the path of a YAML file"


def _explained(path: Path, text: str, error: ValidationError, model: type[BaseModel]) -> Iterator[str]:
    content = read_yaml(text)
    for problem in error.errors():
        location, kind = problem["loc"], problem["type"]
        if kind == "too_short" and len(problem["input"]) >= problem["ctx"]["min_length"]:
            continue  # there are enough, but wrong ones, which have lines of their own
        if location[-1:] == ("int",) and not _is_key(content, location):
            continue  # of a whole number or any, which has its own line
        if location[-1:] == ("float",) and not _is_key(content, location):
            location = location[:-1]
        key = ".".join(str(part) for part in location) or "(file)"
        line = lines_of(text, location)[-1:] or [1]
        yield f"{path}:{line[0]}: {key}: {_message(problem, model)}"


def _is_key(content: Any, location: tuple[int | str, ...]) -> bool:
    """Whether a place is one of the file, where a name may be that of a kind of number, too."""
    try:
        for part in location:
            content = content[part]
    except (LookupError, TypeError):
        return False
    return True


def _message(problem: ErrorDetails, model: type[BaseModel]) -> str:
    kind, value = problem["type"], problem["input"]
    if kind == "missing":
        return "is missing"
    if kind == "extra_forbidden":
        *groups, word = problem["loc"]
        allowed = [key for here in _models_at(model, groups) for key in here.model_fields]
        close = difflib.get_close_matches(str(word), allowed, n=1)
        hint = f"; did you mean {close[0]}? Allowed" if close else "; allowed"
        return f"unknown key{hint} here: {', '.join(allowed)}"
    said = WORDS.get(kind) or problem["msg"].removeprefix("Value error, ")
    said = said.replace("Input should be", "has to be").replace("Tuple should have", "has to have")
    return (
        said.replace(" after validation", "") if isinstance(value, dict | list) else f"{said} (got {value!r})"
    )


def _models_at(model: type[BaseModel], groups: Iterable[int | str]) -> list[type[BaseModel]]:
    """The models of the keys below some keys of a model."""
    here = [model]
    for group in groups:
        if isinstance(group, str):
            here = [
                inner
                for one in here
                if group in one.model_fields
                for inner in models_in(one.model_fields[group].annotation)
            ]
    return here


def lines_of(text: str, location: Iterable[int | str]) -> list[int]:
    """Lines (from 1) of the nodes on the way to `location`, as far as the file has them."""
    node: Any = yaml.compose(text)
    lines: list[int] = []
    for part in location:
        if isinstance(node, yaml.MappingNode):
            found = next((pair for pair in node.value if pair[0].value == str(part)), None)
            if found is None:
                break
            key, node = found
            lines.append(key.start_mark.line + 1)
        elif isinstance(node, yaml.SequenceNode) and str(part).isdigit() and int(part) < len(node.value):
            node = node.value[int(part)]
            lines.append(node.start_mark.line + 1)
        else:
            break
    return lines
