"""What is wrong with the class of an agent that a scenario names, found without running its file."""

from __future__ import annotations

import ast
import symtable
from collections.abc import Collection
from pathlib import Path

PLAIN_METHODS = ("on_tick", "on_packet", "transmit_package")
"""Methods of an agent that are called, not awaited."""
AWAITED = "fly"
"""The one that is."""


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
    if name not in names and "import *" not in text:
        return f"{path} has no class {name}"
    return _wrong_method_in(ast.parse(text), path, name)


def _wrong_method_in(module: ast.Module, path: Path, name: str) -> str:
    classes = (node for node in module.body if isinstance(node, ast.ClassDef) and node.name == name)
    for method in (method for found in classes for method in found.body):
        if isinstance(method, ast.AsyncFunctionDef) and method.name in PLAIN_METHODS:
            return (
                f"{path}:{method.lineno}: {name}.{method.name} is an async def, which nobody would await: make it a "
                "plain def, and start what has to wait with asyncio.create_task, or in fly"
            )
        if isinstance(method, ast.FunctionDef) and method.name == AWAITED and not method.decorator_list:
            return f"{path}:{method.lineno}: {name}.{AWAITED} is a plain def: make it an async def, as it is awaited"
    return ""


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
