"""The code behind a class or function: its file, and the modules of the file's folder that it imports."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path


def sources_of(file: Path) -> list[Path]:
    """A Python file and what it imports from its folder, itself or through others of these; sorted.

    Imports are read, not run: modules that are imported by a computed name, and those of other folders, are not found.

    Raises:
        OSError: one cannot be read.
    """
    found: set[Path] = set()
    new = [file]
    while new:
        here = new.pop()
        if here not in found:
            found.add(here)
            new += _imported(here, file.parent)
    return sorted(found)


def _imported(file: Path, folder: Path) -> Iterator[Path]:
    for level, name in _imports(file.read_bytes()):
        path = file.parents[level - 1] if level else folder
        for part in name.split("."):
            path = path / part
            yield from (each for each in (path.with_suffix(".py"), path / "__init__.py") if each.is_file())
            if not path.is_dir():
                break


@lru_cache(maxsize=1024)
def _imports(source: bytes) -> tuple[tuple[int, str], ...]:
    """Each import of a source text: how many dots it begins with, and its name."""
    try:
        tree = ast.parse(source)
    except (SyntaxError, ValueError):
        return ()  # whoever loads it says so
    found: list[tuple[int, str]] = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found += [(0, each.name) for each in node.names]
        elif isinstance(node, ast.ImportFrom):
            module = f"{node.module}." if node.module else ""
            found += [(node.level, module + each.name) for each in node.names if each.name != "*"]
            found += [(node.level, node.module)] if node.module else []
    return tuple(dict.fromkeys(found))
