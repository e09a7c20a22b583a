"""Two sessions of tests on one machine do not take each other's ports."""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import ExitStack
from itertools import pairwise

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
    monkeypatch.setenv("PYTEST_XDIST_WORKER_COUNT", str(workers))
    begin = []
    for worker in range(workers):
        monkeypatch.setenv("PYTEST_XDIST_WORKER", f"gw{worker}")
        found = slots.slots_of_this_process()
        assert len(set(found)) == len(found) >= 80
        assert min(found) >= FIRST_SLOT + 20
        assert max(found) <= LAST_INSTANCE
        begin.append(found[0])
    assert all(after - before >= 24 for before, after in pairwise(begin))


def test_slots_that_end_in_those_of_another_process_are_found(
    free_slot: Callable[[int], int],
) -> None:
    """The last slot that is left in a process's own part is none for many UA."""
    assert len({free_slot(24), free_slot(1), free_slot(24)}) == 3
