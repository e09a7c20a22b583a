"""What is wrong with a class or function that a scenario names, found without running its file."""

from __future__ import annotations

import ast
import symtable
from collections.abc import Collection, Iterator
from functools import lru_cache
from pathlib import Path

from bridge.scenario.agent_class import wrong_with_class
from bridge.scenario.resolve.sources import sources_of

SOURCES_KEPT = 64
"""So many source texts are not parsed again: each case of a study, and each UA, names the same."""


def mistake_in(place: str, name: str, kind: str = "class") -> str:
    """What is wrong with the class (or function) ``name`` in a file, found without running it; empty = nothing."""
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
        return f"{path} has no {kind} {name}"
    wrong = wrong_with_class(_module(text), name) if kind == "class" else None
    return "" if wrong is None else f"{path}:{wrong[0]}: {wrong[1]}"


def unread_options(place: str, options: Collection[str]) -> list[str]:
    """Which options the file of an agent, and what it imports from its folder, never name; found without running them.

    A name counts wherever it stands: as a text, an argument, a field.
    """
    if not options or not place.endswith(".py"):
        return []
    try:
        texts = [file.read_text(encoding="utf-8") for file in sources_of(Path(place))]
        named = frozenset[str]().union(*map(_words_in, texts))
    except (OSError, SyntaxError, ValueError):
        return []  # a file beside the agent's that is no code: whoever loads it says so
    return [option for option in options if option not in named]


def is_plain(place: str, name: str) -> bool:
    """Whether a class derives from `Agent` alone: then nothing but its folder's code reads its options."""
    found = (
        node
        for node in _module(Path(place).read_text(encoding="utf-8")).body
        if isinstance(node, ast.ClassDef)
    )
    return any(
        each.name == name and [ast.unparse(base) for base in each.bases] == ["Agent"] for each in found
    )


def options_read(place: str) -> list[str]:
    """The texts by which an agent's own file asks for something: ``options["height_m"]``, ``options.get("share")``."""
    found: set[str] = set()
    for node in ast.walk(_module(Path(place).read_text(encoding="utf-8"))):
        if isinstance(node, ast.Subscript):
            asked: list[ast.expr] = [node.slice]
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "get":
            asked = node.args[:1]
        else:
            continue
        found.update(
            each.value for each in asked if isinstance(each, ast.Constant) and isinstance(each.value, str)
        )
    return sorted(found)


@lru_cache(maxsize=SOURCES_KEPT)
def _module(source: str) -> ast.Module:
    return ast.parse(source)


@lru_cache(maxsize=SOURCES_KEPT)
def _words_in(source: str) -> frozenset[str]:
    return frozenset(_words_of(_module(source)))


def _words_of(module: ast.Module) -> Iterator[str]:
    for node in ast.walk(module):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value
        elif isinstance(node, ast.arg | ast.keyword) and node.arg is not None:
            yield node.arg
        elif isinstance(node, ast.Name):
            yield node.id
        elif isinstance(node, ast.Attribute):
            yield node.attr


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
