"""What tests of several kinds share."""

from __future__ import annotations

import gc
import lzma
import os
import re
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from functools import cache
from itertools import islice
from pathlib import Path

import pytest
from hypothesis import settings

from bridge.fleet.autopilots.ardupilot import ArduPilot
from bridge.fleet.autopilots.launcher import AutopilotError
from bridge.run.px4 import find_px4
from tests.slots import lock, slot_is_free, slots_of_this_process
from tests.warm import OF_NO_RUN

settings.register_profile("any machine", deadline=None, max_examples=40)
settings.register_profile("many examples", deadline=None, max_examples=1000)
settings.load_profile("any machine")


def pytest_itemcollected(item: pytest.Item) -> None:
    """`make test-slow` collects the files that have the word."""
    if item.get_closest_marker("slow") and not says_slow(item.path):
        raise pytest.UsageError(
            f"{item.nodeid} is slow, and its file does not say so: mark it where it stands"
        )


@cache
def says_slow(file: Path) -> bool:
    """Whether a file has the word, as `grep --word-regexp` sees it."""
    return re.search(r"\bslow\b", file.read_text(encoding="utf-8")) is not None


def pytest_collection_finish() -> None:
    """What was imported stays: the collector need not look through it again and again."""
    gc.freeze()


@pytest.fixture(autouse=True)
def environment_of_each() -> Iterator[None]:
    """Leave the environment as it was: a Dask cluster sets variables in our process that its workers shall inherit."""
    before = dict(os.environ)
    yield
    for name in {*before, *os.environ}:
        if not name.startswith(OF_NO_RUN) and before.get(name) != os.environ.get(name):
            os.environ.pop(name, None)
            os.environ.update({name: before[name]} if name in before else {})


def _ardupilot_binary(name: str) -> Path:
    try:
        return ArduPilot(os.environ).binary(name)
    except AutopilotError:
        pytest.skip(f"no {name}: neither ARDUPILOT_HOME nor PATH leads to one")


@pytest.fixture
def arducopter() -> Path:
    """A real ArduCopter, or the test is skipped."""
    return _ardupilot_binary("arducopter")


@pytest.fixture
def arduplane() -> Path:
    """A real ArduPlane, or the test is skipped."""
    return _ardupilot_binary("arduplane")


@pytest.fixture
def px4() -> Path:
    """A real PX4, or the test is skipped."""
    found = find_px4(os.environ)
    if found is None:
        pytest.skip("no px4: neither PX4_HOME nor PATH leads to one")
    return found


@pytest.fixture
def px4_home(tmp_path: Path) -> Path:
    """A checkout with the files of PX4's build that are looked at; its binary ends at once."""
    home = tmp_path / "PX4-Autopilot"
    build = home / "build" / "px4_sitl_default"
    for folder in ("bin", "etc/init.d-posix", "etc/extras"):
        (build / folder).mkdir(parents=True)
    (build / "bin" / "px4").write_text("#!/bin/sh\n")
    (build / "bin" / "px4").chmod(0o755)
    (build / "etc" / "extras" / "all_events.json.xz").write_bytes(lzma.compress(b'{"components": {}}'))
    return home


@pytest.fixture
def free_slot() -> Iterator[Callable[[int], int]]:
    """Find a port slot at which ``count`` UA find all their ports free; each call gives another.

    It is locked until the test ends: another session of tests on this machine would find its ports free, too.
    """
    slots_of_tests = slots_of_this_process()
    candidates, last = iter(slots_of_tests), max(slots_of_tests)
    with ExitStack() as held:

        def find(count: int) -> int:
            for slot in candidates:
                slots = range(slot, slot + count)
                if slots[-1] <= last and slot_is_free(slot, count) and lock(slots, held):
                    deque(islice(candidates, count - 1), maxlen=0)
                    return slot
            raise AssertionError(f"no {count} port slots in a row are free for tests up to {last}")

        yield find
