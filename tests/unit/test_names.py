"""One name means one thing: a public class name stands once in all packages; no function is longer than a page."""

from __future__ import annotations

import ast
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGES = ("aps", "bridge", "channel", "fdm", "lostlink", "standin")
LINES_MAX = 60


def nodes() -> Iterator[tuple[Path, ast.AST]]:
    for package in PACKAGES:
        for file in sorted((ROOT / package).rglob("*.py")):
            for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
                yield file.relative_to(ROOT), node


def test_a_public_class_name_stands_once() -> None:
    places: dict[str, list[str]] = defaultdict(list)
    for file, node in nodes():
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            places[node.name].append(f"{file}:{node.lineno}")
    several = {name: where for name, where in places.items() if len(where) > 1}
    assert several == {}


def test_no_function_is_longer_than_a_page() -> None:
    longer = [
        f"{file}:{node.lineno}: {node.name}"
        for file, node in nodes()
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        and (node.end_lineno or 0) - node.lineno >= LINES_MAX
    ]
    assert longer == []
