"""No modules import each other in a circle, not for types alone either."""

from __future__ import annotations

import ast
from graphlib import TopologicalSorter
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGES = ("aps", "bridge", "channel", "fdm", "lostlink", "sitl_configs", "standin")


def imported(tree: ast.Module) -> set[str]:
    """All names that are imported anywhere: of ``from a import b`` both ``a.b``, if that is a module, and ``a``."""
    names = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports are absolute"
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def test_no_modules_import_each_other_in_a_circle() -> None:
    files = [file.relative_to(ROOT) for package in PACKAGES for file in (ROOT / package).rglob("*.py")]
    modules = {".".join(file.with_suffix("").parts).removesuffix(".__init__"): file for file in files}
    graph = {}
    for module, file in modules.items():
        names = imported(ast.parse((ROOT / file).read_text(encoding="utf-8")))
        found = {name if name in modules else name.rpartition(".")[0] for name in names}
        graph[module] = found & modules.keys() - {module}
    assert len(graph) > 500
    TopologicalSorter(graph).prepare()  # raises CycleError, which names the circle
