"""What there is one of per UA starts without what only the router needs: scipy alone takes longer than the rest."""

from __future__ import annotations

import subprocess
import sys

import pytest


@pytest.mark.parametrize(
    ("module", "not_needed"),
    [
        (
            "bridge.host.process",
            "scipy matplotlib jsbsim channel.link.radio bridge.scenario.file rosbags pyarrow",
        ),
        ("bridge.radio.router.process", "asyncio scipy matplotlib jsbsim pymavlink rosbags pyarrow"),
        ("bridge.bus.messages", "numpy rosbags"),
        pytest.param(
            "bridge.physics.process",
            "scipy asyncio matplotlib channel.link.radio bridge.scenario.file rosbags pyarrow",
            marks=pytest.mark.slow,
        ),
        ("lostlink.cli.main", "pydantic asyncio numpy rich"),
        ("lostlink.cli.flying.run", "scipy matplotlib pymavlink jsbsim psutil"),
        ("bridge.record.streams", "numpy rosbags pymavlink pydantic zenoh"),
        pytest.param(
            "bridge.record.events", "numpy rosbags pymavlink pydantic zenoh", marks=pytest.mark.slow
        ),
        pytest.param("bridge.record.inputs.file", "pymavlink pydantic zenoh", marks=pytest.mark.slow),
        ("channel.cli.plots", "scipy matplotlib"),
        ("standin.cli", "numpy scipy pydantic bridge.scenario.model"),
    ],
)
def test_process_imports_no_more_than_it_needs(module: str, not_needed: str) -> None:
    script = f"import sys, {module}; print([m for m in {not_needed.split()} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
