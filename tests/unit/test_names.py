"""One name means one thing: a public class name stands once in all packages; no function is longer than a page."""

from __future__ import annotations

import ast
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGES = ("aps", "bridge", "channel", "fdm", "lostlink", "standin")
LINES_MAX = 60


@cache
def definitions() -> list[tuple[Path, ast.stmt]]:
    """Of classes and functions, also those in others."""
    files = [file for package in PACKAGES for file in sorted((ROOT / package).rglob("*.py"))]
    return [
        (file.relative_to(ROOT), node) for file in files for node in _defined(ast.parse(file.read_bytes()))
    ]


def _defined(parent: ast.AST) -> Iterator[ast.stmt]:
    """By statements only: expressions, most of a tree, hold no definitions."""
    for node in ast.iter_child_nodes(parent):
        if isinstance(node, ast.stmt | ast.excepthandler | ast.match_case):
            if isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
                yield node
            yield from _defined(node)


def test_a_public_class_name_stands_once() -> None:
    places: dict[str, list[str]] = defaultdict(list)
    for file, node in definitions():
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            places[node.name].append(f"{file}:{node.lineno}")
    several = {name: where for name, where in places.items() if len(where) > 1}
    assert several == {}


def test_no_function_is_longer_than_a_page() -> None:
    longer = [
        f"{file}:{node.lineno}: {node.name}"
        for file, node in definitions()
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        and (node.end_lineno or 0) - node.lineno >= LINES_MAX
    ]
    assert longer == []
