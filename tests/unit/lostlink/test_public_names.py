"""What `from lostlink import ...` gives, and what that loads."""

from __future__ import annotations

import subprocess
import sys

import pytest

import lostlink


@pytest.mark.parametrize("name", lostlink.__all__)
def test_each_name_is_there(name: str) -> None:
    assert getattr(lostlink, name).__name__ == name


def test_what_an_agent_needs_loads_nothing_that_flies_or_reads_runs() -> None:
    code = (
        "import sys\n"
        "from lostlink import Agent, CommandFailed, Measurement, Reception\n"
        "print([name for name in sys.modules if name.startswith(('lostlink.', 'jsbsim', 'pyarrow', 'pandas'))])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"
