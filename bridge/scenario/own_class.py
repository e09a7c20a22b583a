"""What is wrong with the class of an agent that a scenario names, found without running its file."""

from __future__ import annotations

import symtable
from collections.abc import Collection
from pathlib import Path


def mistake_in(place: str, name: str) -> str:
    """What is wrong with a class ``name`` in the file ``place``, found without running it; empty = nothing."""
    if not place.endswith(".py"):
        return ""
    path = Path(place)
    if not path.is_file():
        return f"{path}: no such file"
    try:
        text = path.read_text(encoding="utf-8")
        names = symtable.symtable(text, str(path), "exec").get_identifiers()
    except SyntaxError as error:
        return f"{path}:{error.lineno}: {error.msg}"
    except (OSError, ValueError) as error:
        return f"{path}: {error}"
    return "" if name in names or "import *" in text else f"{path} has no class {name}"


def clash_of(places: Collection[str]) -> str:
    """Which module lies beside agents in more than one folder; empty = none.

    UA may share a process, and a process imports a module of one name once: whose it is would depend on the split.
    """
    folders = {Path(place).resolve().parent for place in places if place.endswith(".py")}
    own = {Path(place).resolve() for place in places if place.endswith(".py")}
    first: dict[str, Path] = {}
    for folder in sorted(folders):
        for module in sorted(folder.glob("*.py")):
            if module in own:
                continue  # an agent's own file is loaded for each UA under a name of its own
            if module.name in first:
                return (
                    f"{first[module.name]} and {module} have one name, and UA may share a process: rename one, or keep "
                    "the agents in one folder"
                )
            first[module.name] = module
    return ""
