"""One name means one thing: a public class name stands once in all packages; no function is longer than a page."""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGES = ("aps", "bridge", "channel", "fdm", "lostlink", "sitl_configs", "standin")
LINES_MAX = 60
DEFINED = re.compile(r"( *)(?:async )?(?:def|class) ")


@cache
def texts() -> dict[Path, str]:
    """Of all files."""
    files = [file for package in PACKAGES for file in sorted((ROOT / package).rglob("*.py"))]
    return {file: file.read_text(encoding="utf-8") for file in files}


def definitions(files: Iterable[Path]) -> Iterator[tuple[Path, ast.stmt]]:
    """Of classes and functions, also those in others. A tree takes long: the text says which files can matter."""
    for file in sorted(files):
        for node in _defined(ast.parse(texts()[file])):
            yield file.relative_to(ROOT), node


def _defined(parent: ast.AST) -> Iterator[ast.stmt]:
    """By statements only: expressions, most of a tree, hold no definitions."""
    for node in ast.iter_child_nodes(parent):
        if isinstance(node, ast.stmt | ast.excepthandler | ast.match_case):
            if isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
                yield node
            yield from _defined(node)


def test_a_public_class_name_stands_once() -> None:
    read: dict[str, list[Path]] = defaultdict(list)
    for file, text in texts().items():
        for name in re.findall(r"^ *class (\w+)", text, re.MULTILINE):
            read[name].append(file)
    places: dict[str, list[str]] = defaultdict(list)
    for file, node in definitions({file for where in read.values() if len(where) > 1 for file in where}):
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            places[node.name].append(f"{file}:{node.lineno}")
    several = {name: where for name, where in places.items() if len(where) > 1}
    assert several == {}


def may_be_long(text: str) -> bool:
    """Whether a function ends so far from its beginning, at the latest where another begins that is not in it."""
    lines = text.splitlines()
    begins = [(n, len(found[1])) for n, line in enumerate(lines) if (found := DEFINED.match(line))]
    ends = [
        next((n for n, at in begins[i + 1 :] if at <= indent), len(lines))
        for i, (_, indent) in enumerate(begins)
    ]
    return any(end - begin > LINES_MAX for (begin, _), end in zip(begins, ends, strict=True))


def test_no_function_is_longer_than_a_page() -> None:
    longer = [
        f"{file}:{node.lineno}: {node.name}"
        for file, node in definitions(file for file, text in texts().items() if may_be_long(text))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        and (node.end_lineno or 0) - node.lineno >= LINES_MAX
    ]
    assert longer == []
