"""Two sessions of tests on one machine do not take each other's ports."""

from __future__ import annotations

import os
from contextlib import ExitStack

import pytest

from tests import slots


def test_a_locked_slot_is_nobody_elses_until_it_is_let_go(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(slots, "NAME", f"lostlink-{os.getpid()}-test-slot")
    with ExitStack() as other:
        with ExitStack() as one:
            assert slots.lock(range(20, 23), one)
            assert not slots.lock(range(22, 24), other)
            assert slots.lock([23], other)
        assert slots.lock(range(20, 23), other)
