"""Passwords are made per run, kept from others, and forgotten."""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Iterator
from pathlib import Path

import pytest

from bridge.bus.identity import keyring as module
from bridge.bus.identity.keyring import OBSERVERS, Credentials, Keyring
from bridge.bus.identity.roster import roster

IDENTITIES = roster(("0", "gcs"), {"host-0": ("0",)})


@pytest.fixture(params=[0o000, 0o022, 0o077])
def any_umask(request: pytest.FixtureRequest) -> Iterator[None]:
    before = os.umask(request.param)
    yield
    os.umask(before)


@pytest.mark.usefixtures("any_umask")
def test_files_are_for_their_owner_only_whatever_the_umask(tmp_path: Path) -> None:
    keyring = Keyring.create(tmp_path / "secrets", IDENTITIES)
    assert keyring.path == tmp_path / "secrets"
    assert stat.S_IMODE(keyring.path.stat().st_mode) == 0o700
    assert {stat.S_IMODE(file.stat().st_mode) for file in keyring.path.iterdir()} == {0o600}


def test_each_run_has_its_own_but_for_observers(tmp_path: Path) -> None:
    first, second = (Keyring.create(tmp_path / name, IDENTITIES) for name in "ab")
    assert first.identities == second.identities == IDENTITIES
    for identity in IDENTITIES:
        one, other = first.credentials(identity.name), second.credentials(identity.name)
        assert one.user == other.user == identity.name
        assert (one == other) == (identity.name == "observer")
    assert first.credentials("observer") == OBSERVERS
    lines = first.dictionary.read_text().splitlines()
    assert lines == [f"{i.name}:{first.credentials(i.name).password}" for i in IDENTITIES]


def test_it_is_never_printed_by_accident() -> None:
    assert "hush" not in repr(Credentials("node-1", "hush"))


def test_it_is_forgotten_once_or_twice(tmp_path: Path) -> None:
    keyring = Keyring.create(tmp_path / "secrets", IDENTITIES)
    keyring.remove()
    assert not keyring.path.exists()
    keyring.remove()


@pytest.mark.parametrize("name", ["host-0.json", "passwords", "roster.json"])
def test_one_that_cannot_be_written_leaves_nothing(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = os.open

    def full(path: str | Path, *rest: int, **more: int | None) -> int:
        if Path(path).name == name:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
        return real(path, *rest, **more)

    monkeypatch.setattr(os, "open", full)
    with pytest.raises(OSError, match="No space left on device"):
        Keyring.create(tmp_path / "secrets", IDENTITIES)
    assert list(tmp_path.iterdir()) == []


def test_files_of_somebody_else_are_told(tmp_path: Path) -> None:
    (tmp_path / "roster.json").write_text('[{"name": "node-1", "role": "KING", "nodes": []}]')
    (tmp_path / "node-1.json").write_text('{"user": "node-1"}')
    with pytest.raises(ValueError, match=r"roster.json: not the identities of a run: 'KING'"):
        _ = Keyring(tmp_path).identities
    with pytest.raises(ValueError, match=r"node-1.json: not a user and a password"):
        Keyring(tmp_path).credentials("node-1")


def test_a_file_system_without_permissions_is_not_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The file system is one that gives everybody everything, as FAT does: directories below `fat` are made so."""
    real = Path.mkdir

    def mkdir(path: Path, mode: int = 0o777) -> None:
        real(path, mode)
        if path.parent.name == "fat":
            path.chmod(0o777)

    (tmp_path / "fat").mkdir()
    (tmp_path / "tmp").mkdir()
    monkeypatch.setattr(Path, "mkdir", mkdir)
    monkeypatch.setattr(module.tempfile, "tempdir", str(tmp_path / "tmp"))
    keyring = Keyring.create(tmp_path / "fat" / "secrets", IDENTITIES)
    assert keyring.path.parent == tmp_path / "tmp"
    assert stat.S_IMODE(keyring.path.stat().st_mode) == 0o700
    assert not (tmp_path / "fat" / "secrets").exists()
    keyring.remove()
    assert list((tmp_path / "tmp").iterdir()) == []
