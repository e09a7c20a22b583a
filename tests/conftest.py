"""What tests of several kinds share."""

from __future__ import annotations

import lzma
import os
import socket
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from hypothesis import settings

from bridge.fleet.autopilots.ardupilot import ArduPilot
from bridge.fleet.autopilots.launcher import AutopilotError
from bridge.run.px4 import find_px4
from tests.warm import OF_NO_RUN

settings.register_profile("any machine", deadline=None, max_examples=40)
settings.register_profile("many examples", deadline=None, max_examples=1000)
settings.load_profile("any machine")


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


def _is_free(kind: socket.SocketKind, port: int) -> bool:
    with socket.socket(type=kind) as probe:
        try:
            probe.bind(("127.0.0.1", port))
        except OSError:
            return False
    return True


def _slot_is_free(slot: int, count: int) -> bool:
    tcp = [
        base + 10 * (slot + i) + extra
        for i in range(count)
        for base, extra in ((5760, 0), (5760, 2), (5760, 3))
    ]
    tcp += [base + 10 * (slot + i) for i in range(count) for base in (6760, 8760)]
    tcp += [4560 + slot + i for i in range(count)]
    udp = [base + 10 * (slot + i) for i in range(count) for base in (9002, 5501, 5760, 5761)]
    return all(_is_free(socket.SOCK_STREAM, p) for p in tcp) and all(
        _is_free(socket.SOCK_DGRAM, p) for p in udp
    )


SLOTS, SLOTS_FOR_MANY = 100, 230
"""At slot s + 100 autopilots listen where the daemons of slot s do: 5760 + 10 (s + 100). More than three processes need
more slots than that."""


def _slots_of_this_process() -> range:
    """Slots that no other test process of this session uses."""
    workers = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
    worker = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))
    size = (SLOTS if workers <= 3 else SLOTS_FOR_MANY) // workers
    first = 20 + worker * size
    return range(first + os.getpid() % 8, first + size)


@pytest.fixture
def free_slot() -> Callable[[int], int]:
    """Find a port slot at which ``count`` UA find all their ports free; each call gives another."""
    candidates = iter(_slots_of_this_process())

    def find(count: int) -> int:
        slot = next(s for s in candidates if _slot_is_free(s, count))
        for _ in range(count - 1):
            next(candidates)
        return slot

    return find
