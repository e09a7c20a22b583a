"""Two sessions of tests on one machine do not take each other's ports."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

import pytest

from tests import slots


def test_a_locked_slot_is_nobody_elses_until_it_is_let_go(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(slots, "LOCKS", tmp_path)
    with ExitStack() as other:
        with ExitStack() as one:
            assert slots.lock(range(20, 23), one)
            assert not slots.lock(range(22, 24), other)
            assert slots.lock([23], other)
        assert slots.lock(range(20, 23), other)
