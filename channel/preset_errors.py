"""What is wrong with a tree of keys and values that pydantic refuses, named with file, line and key."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from sitl_configs.config_file import lines_of
from sitl_configs.mistakes import mistakes_in
from sitl_configs.yaml_text import YamlMistake, read_yaml, ships

Tree = dict[str, Any]


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


def tree_in(file: Path, named_by: str = "") -> Tree:
    """Return the mapping that a YAML file is.

    Args:
        file: where.
        named_by: the key that names it.

    Raises:
        PresetError: it cannot be read, is not YAML, or is no mapping.
    """
    try:
        tree = read_yaml(file.read_text(encoding="utf-8"), is_ours=ships(file))
    except OSError as error:
        raise PresetError(f"cannot read {file}: {error.strerror}", key=named_by) from error
    except UnicodeDecodeError as error:
        raise PresetError("is not a file of text", file=str(file)) from error
    except YamlMistake as error:
        raise PresetError(str(error), file=str(file), line=error.line) from error
    if not isinstance(tree, dict):
        raise PresetError("is not a mapping of keys to values", file=str(file))
    return tree


def problems_in(error: ValidationError, model: type[BaseModel]) -> list[tuple[str, str]]:
    """Return the dotted key and the problem of each mistake in what was read as a model."""
    return [(".".join(map(str, key)), problem) for key, problem in mistakes_in(error, model)]


def line_of(file: Path, key: str) -> int | None:
    """Return the line on which the deepest part of a dotted key stands in a YAML file."""
    lines = _lines_of(file, key)
    return lines[-1] if lines else None


def has_key(file: Path, key: str) -> bool:
    """Return whether a dotted key stands in a YAML file."""
    return len(_lines_of(file, key)) == len(key.split("."))


def _lines_of(file: Path, key: str) -> list[int]:
    return lines_of(file.read_text(encoding="utf-8"), key.split("."))
