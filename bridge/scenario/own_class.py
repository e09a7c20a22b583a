"""What is wrong with the class of an agent that a scenario names, found without running its file."""

from __future__ import annotations

import symtable
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
