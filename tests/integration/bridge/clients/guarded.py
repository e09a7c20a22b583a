"""A real router that guards a run of two nodes on two hosts, and clients of it."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import zenoh

from bridge.bus.identity.guard import RouterGuard
from bridge.bus.identity.keyring import Keyring
from bridge.bus.identity.roster import roster
from bridge.bus.session import Sample, Session, free_port, open_client, open_router

RUN = "r"
PREFIX = f"lostlink/{RUN}/"
LONG_S = 10.0


@dataclass
class Heard:
    """Keys (below the run's prefix, where they are) of the samples that came."""

    keys: list[str] = field(default_factory=list)
    changed: threading.Condition = field(default_factory=threading.Condition)

    def __call__(self, sample: Sample) -> None:
        """Take a sample, in Zenoh's thread."""
        with self.changed:
            self.keys.append(str(sample.key_expr).removeprefix(PREFIX))
            self.changed.notify_all()

    def wait_for(self, key: str, again: Callable[[], object] = lambda: None) -> None:
        """Do ``again`` until something came on ``key``."""
        with self.changed:
            for _ in range(round(LONG_S / 0.05)):
                again()
                if self.changed.wait_for(lambda: key in self.keys, 0.05):
                    return
        raise AssertionError(f"nothing came on {key}, only on {self.keys}")


@dataclass
class Guarded:
    """The router, as its own session sees it."""

    endpoint: str
    session: Session
    keyring: Keyring

    def client(self, name: str) -> Session:
        """A client of ours, as ``name``."""
        return open_client(self.endpoint, self.keyring.credentials(name))

    def put_all(self, keys: Iterable[str]) -> None:
        """Publish something on each key, as the radio does."""
        for key in keys:
            self.session.put_bytes(PREFIX + key, b"x", must_arrive=True)

    @contextmanager
    def stranger(self, user: str = "", password: str = "", **settings: Any) -> Iterator[zenoh.Session]:
        """A plain Zenoh session, with nothing of ours; ``__`` in a setting's name stands for ``/``."""
        given = {
            "mode": "client",
            "connect__endpoints": [self.endpoint],
            "scouting__multicast__enabled": False,
        }
        with zenoh.open(plain_config(user, password, **{**given, **settings})) as session:
            yield session


def plain_config(user: str = "", password: str = "", **settings: Any) -> zenoh.Config:
    """A configuration as a user writes it, which tries to connect once."""
    config = zenoh.Config()
    if user:
        settings |= {"transport__auth__usrpwd__user": user, "transport__auth__usrpwd__password": password}
    settings |= {"connect__timeout_ms": 0, "connect__exit_on_failure": True}
    for name, value in settings.items():
        config.insert_json5(name.replace("__", "/"), json.dumps(value))
    return config


@contextmanager
def guarded_router(path: Path, host: str = "127.0.0.1") -> Iterator[Guarded]:
    """Open the router; passwords go to ``path``."""
    hosts = {"host-0": ("0",), "host-1": ("1",)}
    keyring = Keyring.create(path, roster(("0", "1", "2"), hosts, free=("0", "1")))
    endpoint = f"tcp/{host}:{free_port(host)}"
    with open_router(endpoint, RouterGuard(RUN, keyring)) as session:
        yield Guarded(endpoint, session, keyring)
