"""Two sessions of tests on one machine do not take each other's ports."""

from __future__ import annotations

import os
from contextlib import ExitStack

import pytest

from bridge.fleet.preflight.slots import FIRST_SLOT, LAST_INSTANCE
from tests import slots


def test_a_locked_slot_is_nobody_elses_until_it_is_let_go(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(slots, "NAME", f"lostlink-{os.getpid()}-test-slot")
    with ExitStack() as other:
        with ExitStack() as one:
            assert slots.lock(range(20, 23), one)
            assert not slots.lock(range(22, 24), other)
            assert slots.lock([23], other)
        assert slots.lock(range(20, 23), other)


@pytest.mark.parametrize("workers", [1, 2, 3, 6])
def test_runs_at_free_ports_and_tests_do_not_meet(workers: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """A slot that is free between two runs of a study is not given to a test."""
    taken: set[int] = set()
    for worker in range(workers):
        monkeypatch.setenv("PYTEST_XDIST_WORKER_COUNT", str(workers))
        monkeypatch.setenv("PYTEST_XDIST_WORKER", f"gw{worker}")
        ours = set(slots.slots_of_this_process())
        assert len(ours) >= 24
        assert not ours & taken
        taken |= ours
    assert min(taken) >= FIRST_SLOT + 20
    assert max(taken) <= LAST_INSTANCE
