"""What the Makefile says of a Python that the pinned packages are not built for."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
OTHER_PYTHON = """#!/bin/sh
exec {python} -c 'import sys
sys.version_info, sys.version = {info}, "{version} (main)"
exec(sys.argv[-1])' "$@"
"""


@pytest.mark.parametrize(("version", "is_fit"), [("3.10.9", False), ("3.14.8", True), ("3.15.0", False)])
def test_only_a_python_that_the_locks_serve_is_installed_with(
    tmp_path: Path, version: str, is_fit: bool
) -> None:
    for name in ("Makefile", "pyproject.toml", "requirements"):
        (tmp_path / name).symlink_to(ROOT / name)
    info = tuple(map(int, version.split(".")))
    python = tmp_path / "python"
    python.write_text(OTHER_PYTHON.format(python=sys.executable, info=info, version=version))
    python.chmod(0o755)
    (tmp_path / "venv" / "bin").mkdir(parents=True)
    shutil.copy("/bin/true", tmp_path / "venv" / "bin" / "python")  # in the place of pip
    done = subprocess.run(
        ["make", "venv/.run", "VENV=venv", f"PYTHON={python}"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert (done.returncode == 0) == is_fit, done.stderr
    assert (tmp_path / "venv" / ".run").exists() == is_fit
    if not is_fit:
        assert (
            f"Python 3.11 to 3.14 (what requirements/ pins has no builds for others); this is {version}"
            in (done.stderr)
        )
