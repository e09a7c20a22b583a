"""Port slots: never the same one twice at a time, and free again when their holder is gone, however it ended."""

from __future__ import annotations

import subprocess
import sys
from contextlib import ExitStack

import pytest

from bridge.fleet.preflight import slots
from bridge.fleet.preflight.slots import NoSlot, lease

HOLDER = """
from bridge.fleet.preflight.slots import lease
with lease(3) as slot:
    print(slot, flush=True)
    input()
"""


@pytest.fixture(autouse=True)
def own_folder(tmp_path, monkeypatch):
    monkeypatch.setattr(slots.tempfile, "gettempdir", lambda: str(tmp_path))
    monkeypatch.setenv("TMPDIR", str(tmp_path))


def test_rows_do_not_meet_and_come_back():
    with lease(3) as first:
        with lease(2) as second:
            assert second == first + 3
        with lease(4) as third:
            assert third == second
    with lease(1) as again:
        assert again == first


def test_a_row_whose_ports_are_taken_is_passed_over():
    with lease(1, lambda slot: slot % 10 == 7) as slot:
        assert slot % 10 == 7


def test_too_many_are_refused():
    with ExitStack() as held:
        held.enter_context(lease(200))
        with pytest.raises(NoSlot, match="no 100 port slots"):
            held.enter_context(lease(100))


def test_a_killed_process_holds_nothing():
    with subprocess.Popen(
        [sys.executable, "-c", HOLDER], stdout=subprocess.PIPE, stdin=subprocess.PIPE
    ) as holder:
        assert holder.stdout is not None
        held = int(holder.stdout.readline())
        with lease(1) as mine:
            assert mine == held + 3
        holder.kill()
        holder.wait()
    with lease(1) as mine:
        assert mine == held
