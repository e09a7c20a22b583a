"""The code behind a class or function: its file, and all that it imports but Python's and lostlink's own."""

from __future__ import annotations

import ast
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

from bridge.scenario.resolve.modules import CODE, Modules, file_of, found_in, installed
from sitl_configs.own_code import OURS

IMPORTERS = ("import_module", "__import__")
Stamp = tuple[str, int, int]
"""Path, time of the last change and size of a file or folder: as long as it is the same, so is what is in there."""


@dataclass(frozen=True, slots=True)
class Code:
    """What a class or function is made of.

    Attributes:
        files: absolute, in the order in which imports lead to them, which is the same wherever they lie: those beside
            its file, on PYTHONPATH and of editable installs.
        packages: version of the installed packages that these import, by name.
    """

    files: tuple[Path, ...] = ()
    packages: Mapping[str, str] = field(default_factory=dict)


def code_of(place: str, own: str = "") -> Code:
    """The code of a file (ending in .py) or module, with what it imports, itself or through others.

    Imports are read, not run: modules that are imported by a computed name are not found. What installed packages
    import is theirs.

    Args:
        place: the file or module.
        own: a package whose files count even if it is installed.

    Raises:
        OSError: a file cannot be read.
    """
    modules = Modules(place)
    key = (str(Path(place).absolute()) if place.endswith(CODE) else place, own, modules.path)
    known = _known.get(key)
    if known is None or known[1] != [stamp_of(path) for path, _, _ in known[1]]:
        known = _known[key] = _walked(key[0], own, modules)
    return known[0]


_known: dict[tuple[str, str, tuple[str, ...]], tuple[Code, list[Stamp]]] = {}


def stamp_of(path: str | Path) -> Stamp:
    """Of a file or folder, also of one that is not there."""
    try:
        about = os.stat(path)  # noqa: PTH116
    except OSError:
        return str(path), 0, -1
    return str(path), about.st_mtime_ns, about.st_size


def _walked(place: str, own: str, modules: Modules) -> tuple[Code, list[Stamp]]:
    walk = _Walk(own, modules)
    if place.endswith(CODE):
        walk.add(Path(place))
    else:
        walk.add_module(place)
    walk.go()
    folders = {*modules.path, *(str(file.parent) for file in walk.files)}  # where others may appear
    stamps = [stamp_of(each) for each in (*map(str, walk.files), *folders)]
    return Code(tuple(walk.files), dict(sorted(walk.packages.items()))), stamps


class _Walk:
    def __init__(self, own: str, modules: Modules) -> None:
        self._own, self._modules = own, modules
        self._new: list[Path] = []
        self.files: dict[Path, None] = {}
        self.packages: dict[str, str] = {}

    def add(self, file: Path) -> None:
        if file not in self.files:
            self.files[file] = None
            self._new.append(file)

    def add_module(self, name: str) -> None:
        top = name.partition(".")[0]
        found = [] if top in OURS else self._modules.found(name)
        if found and top != self._own and (packages := installed(found[0])):
            self.packages.update(packages)
            return
        for file in filter(None, map(file_of, found)):
            self.add(file)

    def go(self) -> None:
        while self._new:
            file = self._new.pop()
            for level, name in imports_of(file):
                if not level:
                    self.add_module(name)
                    continue
                for found in filter(None, map(file_of, found_in(name, [str(file.parents[level - 1])]))):
                    self.add(found)


def parsed(file: Path) -> ast.Module:
    """The syntax tree of a file.

    Raises:
        OSError: it cannot be read.
        SyntaxError, ValueError: it is no Python.
    """
    return _parsed(stamp_of(file))


@lru_cache(maxsize=64)
def _parsed(stamp: Stamp) -> ast.Module:
    return ast.parse(Path(stamp[0]).read_bytes(), stamp[0])


def imports_of(file: Path) -> tuple[tuple[int, str], ...]:
    """Each import of a file: how many dots it begins with, and its name; none of what is no Python.

    Raises:
        OSError: it cannot be read.
    """
    return _imports(stamp_of(file)) if file.suffix == CODE else ()


@lru_cache(maxsize=4096)
def _imports(stamp: Stamp) -> tuple[tuple[int, str], ...]:
    try:
        tree = _parsed(stamp)
    except (SyntaxError, ValueError):
        return ()  # whoever loads it says so
    return tuple(dict.fromkeys(found for node in ast.walk(tree) for found in _imported_by(node)))


def _imported_by(node: ast.AST) -> Iterator[tuple[int, str]]:
    if isinstance(node, ast.Import):
        yield from ((0, each.name) for each in node.names)
    elif isinstance(node, ast.ImportFrom):
        module = f"{node.module}." if node.module else ""
        yield from ((node.level, module + each.name) for each in node.names if each.name != "*")
        if node.module:
            yield node.level, node.module
    elif isinstance(node, ast.Call) and node.args and isinstance(node.args[0], ast.Constant):
        called, name = getattr(node.func, "attr", getattr(node.func, "id", "")), node.args[0].value
        if called in IMPORTERS and isinstance(name, str) and name.strip("."):
            yield len(name) - len(name.lstrip(".")), name.lstrip(".")
