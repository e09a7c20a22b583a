"""The package of docs/reference/agents.md, as it stands there, is found by `check` and by a study."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

from bridge.agents.own import load_class
from bridge.scenario.file import read_scenario
from bridge.scenario.resolve.named_files import named_code
from lostlink.study.study import Study

TEXT = (Path(__file__).parents[4] / "docs" / "reference" / "agents.md").read_text(encoding="utf-8")
BLOCK = re.compile(r"^```\w+ (\S+)\n(.*?)^```$", re.DOTALL | re.MULTILINE)


def test_the_package_of_the_page_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, text in BLOCK.findall(TEXT):
        file = tmp_path / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path / "src")
    assert [file.name for file in named_code(read_scenario(tmp_path / "flock.yaml")).files] == [
        "__init__.py",
        "agent.py",
        "rules.py",
    ]
    assert len(Study(tmp_path / "study.yaml", tmp_path).left()) == 4
    assert load_class("flocking.agent", "Flock").__name__ == "Flock"
    for name in [each for each in sys.modules if each.partition(".")[0] == "flocking"]:
        monkeypatch.delitem(sys.modules, name)
