"""Functions of the user's own: their files import what lies beside them, and what they raise is told with its place."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from lostlink.cli.flying.study import study
from lostlink.study.metrics import load
from lostlink.study.model import Function, StudyError

STUDY = "schema: 1\nname: mine\nscenario: separation\nseeds: 1\n{key}: own_functions.py:found\n"


@pytest.fixture(autouse=True)
def _same_modules(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.delitem(sys.modules, "own_beside", raising=False)


def written(folder: Path, text: str, beside: str = "") -> Function:
    """A file with a function, and a module beside it."""
    (folder / "own_beside.py").write_text(beside, encoding="utf-8")
    (folder / "own_functions.py").write_text(text, encoding="utf-8")
    return Function(place=str(folder / "own_functions.py"), name="found")


def test_a_file_may_import_what_lies_beside_it(tmp_path: Path) -> None:
    found = load(
        written(tmp_path, "from own_beside import found\n", "def found(run):\n    return {'a': 5}\n")
    )
    assert found(None) == {"a": 5}


@pytest.mark.parametrize(
    ("text", "beside", "says"),
    [
        ("\nimport nowhere_to_be_found\n", "", "own_functions.py:2: ModuleNotFoundError: No module named"),
        ("\n\ndef found(run:\n", "", "own_functions.py:3: SyntaxError: '(' was never closed"),
        (
            "import own_beside\n",
            "\n\nSPEED = 1 / 0\n",
            "own_beside.py:3: ZeroDivisionError: division by zero",
        ),
        ("import json\njson.loads('')\n", "", "own_functions.py:2: JSONDecodeError: Expecting value"),
        ("raise SystemExit('enough')\n", "", "own_functions.py:1: SystemExit: enough"),
    ],
)
def test_what_a_file_raises_is_told_with_its_line(tmp_path: Path, text: str, beside: str, says: str) -> None:
    with pytest.raises(StudyError) as error:
        load(written(tmp_path, text, beside))
    assert str(error.value).startswith(f"{tmp_path}/{says}")


@pytest.mark.parametrize("key", ["metrics", "figures"])
def test_a_study_with_a_file_that_raises_cannot_be_flown(tmp_path: Path, key: str) -> None:
    written(tmp_path, "SPEED = 1 / 0\n")
    file = tmp_path / "study.yaml"
    file.write_text(STUDY.format(key=key), encoding="utf-8")
    result = CliRunner().invoke(study, [str(file), "--out", str(tmp_path)])
    assert result.exit_code == 2
    assert "own_functions.py:1: ZeroDivisionError: division by zero" in result.output
    assert "Traceback" not in result.output
