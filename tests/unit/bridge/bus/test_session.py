"""How sessions are configured."""

from __future__ import annotations

import json
import subprocess
import sys
import threading

import pytest

from bridge.bus.session import _config, free_port, open_client, open_router
from bridge.timeouts import LEASE_S


def test_a_neighbour_that_is_frozen_is_kept() -> None:
    assert json.loads(_config([]).get_json("transport/link/tx/lease")) == LEASE_S * 1000


SHARED = """
from pathlib import Path
from bridge.bus.session import free_port, open_client, open_router
endpoint = f"tcp/127.0.0.1:{free_port()}"
with open_router(endpoint), open_client(endpoint):
    print(".zenoh" in Path("/proc/self/maps").read_text())
"""


def test_nothing_is_left_in_shared_memory() -> None:
    """Zenoh makes a file there per process, which it never removes; in a process of its own, as others make theirs."""
    done = subprocess.run(
        [sys.executable, "-c", SHARED], capture_output=True, text=True, timeout=60, check=True
    )
    assert done.stdout == "False\n"


def test_a_client_whose_wait_is_interrupted_leaves_nevertheless(monkeypatch: pytest.MonkeyPatch) -> None:
    """By Ctrl-C, or a signal handler that exits."""

    def interrupted(*_: object) -> bool:
        raise KeyboardInterrupt

    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with open_router(endpoint), open_client(endpoint) as client:
        with monkeypatch.context() as patch:
            patch.setattr(threading.Event, "wait", interrupted)
            with pytest.raises(KeyboardInterrupt):
                client.close()
        assert client._inner.is_closed()
