"""Where a class or function that a scenario names is written: there, or in a file from which it is imported there."""

from __future__ import annotations

import ast
import os
import pkgutil
import sys
from pathlib import Path

from bridge.scenario.resolve.modules import CODE, Modules, file_of, found_in
from bridge.scenario.resolve.sources import parsed
from sitl_configs.near import meant
from sitl_configs.own_code import NOT_THERE


def source_of(place: str) -> Path | None:
    """The file of a place, which is a file (ending in .py) or a module; None for a module that has none to be read."""
    if place.endswith(CODE):
        return Path(place)
    found = Modules(place).found(place)
    file = file_of(found[-1]) if len(found) == place.count(".") + 1 else None
    return file if file is not None and file.suffix == CODE else None


def missing(place: str) -> str:
    """That there is no such file or module; empty: there is. Of Python's own modules nothing is said."""
    if place.endswith(CODE):
        return "" if Path(place).is_file() else f"{place}: no such file"
    names = place.split(".")
    if names[0] in sys.stdlib_module_names:
        return ""
    modules = Modules(place)
    found = modules.found(place)
    if len(found) == len(names):
        return ""
    if not found and found_in(names[0], [os.getcwd()]):  # noqa: PTH109
        return f"no module {place}: {names[0]} lies in {Path.cwd()}, which is not on PYTHONPATH"
    folders = list(found[-1].submodule_search_locations or ()) if found else list(modules.path)
    known = {each.name for each in pkgutil.iter_modules(folders)} - (
        set() if found else sys.stdlib_module_names
    )
    near = meant(names[len(found)], sorted(known))
    hint = f"; did you mean {'.'.join([*names[: len(found)], near])}?" if near else ""
    return f"no module {place}: {NOT_THERE}{hint}"


def definition_of(place: str, name: str) -> tuple[Path, str] | None:
    """File and name there of a class or function, through imports of it by ``from``; None if no file is known.

    Only names that such an import at a file's top level binds are followed.

    Raises:
        OSError: a file cannot be read.
        SyntaxError, ValueError: a file is no Python.
    """
    file, modules, seen = source_of(place), Modules(place), set[tuple[Path, str]]()
    while file is not None and (file, name) not in seen:
        seen.add((file, name))
        origin = _imported_from(file, name, modules)
        if origin is None:
            return file, name
        file, name = origin
    return None


def _imported_from(file: Path, name: str, modules: Modules) -> tuple[Path, str] | None:
    """The file that an import binds a name from, and its name there; None if none does, or it is not to be read."""
    for node in parsed(file).body:
        for each in node.names if isinstance(node, ast.ImportFrom) else ():
            if isinstance(node, ast.ImportFrom) and (each.asname or each.name) == name and node.module:
                found = (
                    found_in(node.module, [str(file.parents[node.level - 1])])
                    if node.level
                    else modules.found(node.module)
                )
                origin = file_of(found[-1]) if len(found) == node.module.count(".") + 1 else None
                return (origin, each.name) if origin is not None and origin.suffix == CODE else None
    return None
