"""A schedule of slots from a YAML file, every mistake named with file, line, key and value."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

from pydantic import ValidationError

from channel.access.settings.slots import SlotSchedule
from channel.preset_errors import PresetError, Tree, at_once, line_of, mistakes_in
from sitl_configs.yaml_text import YamlMistake, read_yaml

KEY: Final = "schedule_file"
OF_A_SLOT = re.compile(r"(slots\.\d+(?:\.\w+)?): (.*)", re.DOTALL)
"""What `Schedule` says of one slot."""


def read_schedule(file: Path, named_by: str) -> Tree:
    """Return what a file has, checked, and its own path, by which a run's provenance has its digest.

    Args:
        file: YAML with the keys of `SlotSchedule`.
        named_by: the key that names it.

    Raises:
        PresetError: it cannot be read, is not YAML, or is no schedule.
    """
    tree = _tree(file, named_by) | {"read_from": str(file.absolute())}
    try:
        SlotSchedule.model_validate(tree)
    except ValidationError as error:
        found = mistakes_in(error, tree, SlotSchedule)
    else:
        return tree
    raise at_once([_in_file(file, key, problem) for key, problem in found])


def _in_file(file: Path, key: str, problem: str) -> PresetError:
    if of_a_slot := OF_A_SLOT.fullmatch(problem):
        key, problem = of_a_slot.groups()
    return PresetError(problem, key=key, file=str(file), line=line_of(file, key))


def _tree(file: Path, named_by: str) -> Tree:
    try:
        tree = read_yaml(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise PresetError(f"cannot read {file}: {error.strerror}", key=named_by) from error
    except UnicodeDecodeError as error:
        raise PresetError("is not a file of text", file=str(file)) from error
    except YamlMistake as error:
        raise PresetError(str(error), file=str(file), line=error.line) from error
    if not isinstance(tree, dict):
        raise PresetError("is not a mapping of keys to values", file=str(file))
    return tree
