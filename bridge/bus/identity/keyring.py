"""Passwords of one run, made when it starts and gone when it ends.

They lie in files that only their owner can read, in a directory that only its owner can enter: a process gets
their place, not them. The directory is in that of the run, so that whoever has the run finds it, and a run that was
killed leaves nothing elsewhere (what it leaves opens nothing: its router is gone). On a file system without permissions
it is in the system's directory for temporary files instead.
"""

from __future__ import annotations

import json
import os
import secrets
import shutil
import stat
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from bridge.bus.identity.roster import OBSERVER, Identity
from bridge.bus.identity.table import AccessRole

PASSWORD_BYTES = 24
DICTIONARY = "passwords"
"""File of all users, ``user:password`` in each line, as Zenoh reads it."""
ROSTER = "roster.json"


@dataclass(frozen=True, slots=True)
class Credentials:
    """What a client logs in with."""

    user: str
    password: str = field(repr=False)


OBSERVERS = Credentials(OBSERVER, "observer")
"""Of whoever only looks: the same in every run, and no secret."""


@dataclass(frozen=True, slots=True)
class Keyring:
    """The directory of a run's passwords."""

    path: Path

    @classmethod
    def create(cls, path: Path, identities: Sequence[Identity]) -> Keyring:
        """Make passwords for all ``identities``, at ``path`` if that can be kept from others.

        Raises:
            OSError: if it cannot be made; nothing of it is left then.
        """
        keyring = cls(_private_directory(path))
        try:
            keyring._fill(identities)
        except BaseException:
            keyring.remove()
            raise
        return keyring

    def _fill(self, identities: Sequence[Identity]) -> None:
        users = [_new(identity) for identity in identities]
        for user in users:
            self._write(f"{user.user}.json", json.dumps({"user": user.user, "password": user.password}))
        self._write(DICTIONARY, "".join(f"{user.user}:{user.password}\n" for user in users))
        roster = [{"name": i.name, "role": i.role.name, "nodes": i.nodes} for i in identities]
        self._write(ROSTER, json.dumps(roster))

    @property
    def dictionary(self) -> Path:
        """The file that the router reads."""
        return self.path / DICTIONARY

    @property
    def identities(self) -> tuple[Identity, ...]:
        """Whose passwords these are.

        Raises:
            OSError, ValueError: the file is not there or not ours.
        """
        try:
            entries = json.loads((self.path / ROSTER).read_text(encoding="utf-8"))
            return tuple(Identity(e["name"], AccessRole[e["role"]], tuple(e["nodes"])) for e in entries)
        except (KeyError, TypeError) as error:
            raise ValueError(f"{self.path / ROSTER}: not the identities of a run: {error}") from error

    def credentials(self, name: str) -> Credentials:
        """What the identity ``name`` logs in with.

        Raises:
            OSError, ValueError: the file is not there or not ours.
        """
        file = self.path / f"{name}.json"
        try:
            return Credentials(**json.loads(file.read_text(encoding="utf-8")))
        except TypeError as error:
            raise ValueError(f"{file}: not a user and a password") from error

    def remove(self) -> None:
        """Forget all of them."""
        with suppress(FileNotFoundError):
            shutil.rmtree(self.path)

    def _write(self, name: str, text: str) -> None:
        number = os.open(self.path / name, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(number, "w", encoding="utf-8") as file:
            file.write(text)


def _new(identity: Identity) -> Credentials:
    if identity.name == OBSERVER:
        return OBSERVERS
    return Credentials(identity.name, secrets.token_urlsafe(PASSWORD_BYTES))


def _private_directory(path: Path) -> Path:
    path.mkdir(mode=0o700)
    if stat.S_IMODE(path.stat().st_mode) & 0o077 == 0:
        return path
    path.rmdir()
    return Path(tempfile.mkdtemp(prefix="lostlink-"))
