"""What is wrong with a class or function that a scenario names, found without running its code."""

from __future__ import annotations

import ast
import symtable
from collections.abc import Collection, Iterable, Iterator
from functools import lru_cache
from itertools import chain
from pathlib import Path

from bridge.scenario.own.agent_class import wrong_with_class
from bridge.scenario.resolve.definition import definition_of, missing, source_of
from bridge.scenario.resolve.modules import CODE
from bridge.scenario.resolve.sources import Code, Stamp, code_of, parsed, stamp_of
from sitl_configs.near import near_miss

AGENTS = ("Agent", "lostlink.Agent", "bridge.agents.Agent")


def mistake_in(place: str, name: str, kind: str = "class") -> str:
    """What is wrong with the class (or function) ``name`` in a file or module, without running it; empty = nothing.

    Where its file imports it from another, that one is looked at.
    """
    if mistake := missing(place):
        return mistake
    path = source_of(place)
    try:
        there = definition_of(place, name)
        if there is None or (there[0] != path and there[0] not in _own_code(place).files):
            return ""  # what others' code binds is not for a look at it to tell
        path, name = there
        text = path.read_text(encoding="utf-8")
        names = symtable.symtable(text, str(path), "exec").get_identifiers()
        if name not in names and "__getattr__" not in names and "import *" not in text:
            return f"{path} has no {kind} {name}{near_miss(name, names)}"
        wrong = wrong_with_class(parsed(path), name) if kind == "class" else None
    except SyntaxError as error:
        return f"{error.filename}:{error.lineno}: {error.msg}"
    except (OSError, ValueError) as error:
        return f"{path}: {error}"
    return "" if wrong is None else f"{path}:{wrong[0]}: {wrong[1]}"


def unread_options(place: str, options: Collection[str]) -> list[str]:
    """Which options the file or module of an agent, and what it imports, never name; found without running them.

    A name counts wherever it stands: as a text, an argument, a field.
    """
    if not options:
        return []
    try:
        files = [file for file in _own_code(place).files if file.suffix == CODE]
        named = frozenset[str]().union(*(_words_in(stamp_of(file)) for file in files))
    except (OSError, SyntaxError, ValueError):
        return []  # a file that the agent's imports is no code: whoever loads it says so
    return [option for option in options if option not in named] if files else []


def _own_code(place: str) -> Code:
    """Of an installed package, too, if the class is in it."""
    return code_of(place, "" if place.endswith(CODE) else place.partition(".")[0])


def lineage_of(place: str, name: str) -> tuple[list[Path], bool]:
    """The user's files that a class and those above it are in, and whether nothing but `Agent` is above them.

    If so, nothing but the user's code reads the agent's options.
    """
    classes: set[tuple[Path, str]] = set()
    is_plain = _follow(place, name, classes)
    return sorted({file for file, _ in classes}), is_plain


def _follow(place: str, name: str, seen: set[tuple[Path, str]]) -> bool:
    there = definition_of(place, name)
    if there is None or there[0] not in _own_code(place).files:
        return False
    seen.add(there)
    found = [
        each for each in parsed(there[0]).body if isinstance(each, ast.ClassDef) and each.name == there[1]
    ]
    bases = [base for each in found for base in each.bases if ast.unparse(base) not in AGENTS]
    known = [isinstance(base, ast.Name) and _goes_up(there, base.id, seen) for base in bases]
    return bool(found) and all(known)


def _goes_up(there: tuple[Path, str], base: str, seen: set[tuple[Path, str]]) -> bool:
    file = str(there[0])
    return definition_of(file, base) in seen or _follow(file, base, seen)


def options_read(files: Iterable[Path]) -> list[str]:
    """The texts by which files ask for something: ``options["height_m"]``, ``options.get("share")``."""
    found: set[str] = set()
    for node in chain.from_iterable(ast.walk(parsed(file)) for file in files):
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


@lru_cache(maxsize=4096)
def _words_in(stamp: Stamp) -> frozenset[str]:
    return frozenset(_words_of(parsed(Path(stamp[0]))))


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
