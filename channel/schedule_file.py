"""A schedule of slots from a YAML file, every mistake named with file, line, key and value."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

from pydantic import ValidationError

from channel.access.settings.slots import SlotSchedule
from channel.preset_errors import PresetError, Tree, at_once, line_of, problems_in, tree_in

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
    tree = tree_in(file, named_by) | {"read_from": str(file.absolute())}
    try:
        SlotSchedule.model_validate(tree)
    except ValidationError as error:
        found = problems_in(error, SlotSchedule)
    else:
        return tree
    raise at_once([_in_file(file, key, problem) for key, problem in found])


def _in_file(file: Path, key: str, problem: str) -> PresetError:
    if of_a_slot := OF_A_SLOT.fullmatch(problem):
        key, problem = of_a_slot.groups()
    return PresetError(problem, key=key, file=str(file), line=line_of(file, key))
