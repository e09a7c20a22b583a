"""Examples are copied: what they import of ours is what users are promised (ADR 017)."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[3] / "examples"
AGENTS = sorted(
    path
    for path in EXAMPLES.rglob("*.py")
    if "Agent" in path.read_text() or path.parent.name == "ground_nodes"
)


def imported(path: Path) -> set[str]:
    """The top of each module that a file imports."""
    nodes = ast.walk(ast.parse(path.read_text()))
    return {node.module.split(".")[0] for node in nodes if isinstance(node, ast.ImportFrom) and node.module}


@pytest.mark.parametrize("path", AGENTS, ids=lambda path: f"{path.parent.name}/{path.stem}")
def test_agents_import_of_ours_lostlink_and_the_channel_alone(path: Path) -> None:
    assert "lostlink" in imported(path)
    assert not imported(path) & {"aps", "bridge", "fdm", "sitl_configs", "standin"}
