"""The directory of one run: what its processes need to find each other, and what the run leaves behind."""

from __future__ import annotations

import errno
import fcntl
import json
import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import Any

from bridge.bus.identity.guard import RouterGuard
from bridge.bus.identity.keyring import Credentials, Keyring
from bridge.bus.keys import Keys
from bridge.run.carried import with_radios_carried, with_radios_placed
from bridge.run.json_object import read_object
from bridge.scenario.document.files import Find, files_placed
from bridge.scenario.model import Scenario
from bridge.scenario.recorded import read_recorded
from sitl_configs.yaml_text import yaml_of

RUN_FILE = "run.json"
SCENARIO_FILE = "scenario.yaml"
SUMMARY_FILE = "summary.json"
LIVE_FILE = "live.lock"
"""Locked as long as the run goes on: the lock ends with whoever holds it, in whatever way."""
LOG_FOLDER = "logs"
SECRETS_FOLDER = "secrets"
AGENT_FOLDER = "agents"
TLOG_FOLDER = "tlog"
NAMES_MAX = 1000


@dataclass(frozen=True, slots=True)
class RunInfo:
    """How to reach a running simulation, and what it repeats.

    Attributes:
        run: name of the run.
        endpoint: of its Zenoh router.
        pid: process id of its supervisor.
        replay: directory of the run whose inputs it repeats; "" if it takes those from outside.
        hosts: by name, the ids of the nodes in each.
        secrets: directory of its passwords, as long as it goes on.
        radios: where files of `radios/` came from, by their paths as seen from the run's directory.
    """

    run: str
    endpoint: str
    pid: int
    replay: str = ""
    hosts: dict[str, list[str]] = field(default_factory=dict)
    secrets: str = ""
    radios: dict[str, str] = field(default_factory=dict)


def name_in_utf8(path: Path) -> str:
    """The name of a file or directory as texts can hold it: bytes that are no UTF-8 are U+FFFD."""
    return os.fsencode(path.name).decode(errors="replace")


def new_directory(parent: Path, name: str) -> Path:
    """Make ``<parent>/<name>``; a number is added if that is there already.

    Raises:
        OSError: it cannot be made.
    """
    for suffix in ("", *(f"-{n}" for n in range(2, NAMES_MAX))):
        path = parent / f"{name}{suffix}"
        try:
            path.mkdir(parents=True)
        except FileExistsError:
            if not os.path.lexists(path):  # it is the parent: a link to what is not there
                raise
            continue
        return path
    raise FileExistsError(f"{parent / name}: there are too many of that name")


@dataclass(frozen=True)
class RunDirectory:
    """Paths and contents of a run's directory. What its processes read of it does not change, and is read once."""

    path: Path

    @classmethod
    def create(cls, parent: Path, scenario_name: str) -> RunDirectory:
        """Make ``<parent>/<UTC time>-<scenario>``; a number is added if that is there already.

        Raises:
            OSError: if it cannot be made, or its path is no text in UTF-8, by which alone Parquet and Zenoh open files.
        """
        place = parent.resolve()
        where = os.fsencode(place)
        try:
            text = where.decode("utf-8")
        except UnicodeDecodeError as error:
            raise OSError(errno.EILSEQ, f"{where!r} is no path in UTF-8: name another") from error
        if text != str(place):
            encoding = sys.getfilesystemencoding()
            raise OSError(
                errno.EILSEQ, f"{text!a}: paths are in {encoding} here: set LC_ALL=C.UTF-8, or name another"
            )
        path = new_directory(parent, f"{datetime.now(UTC):%Y%m%dT%H%M%SZ}-{scenario_name}")
        (path / LOG_FOLDER).mkdir()
        return cls(path.resolve())

    @contextmanager
    def going_on(self) -> Iterator[None]:
        """Around all of the run, up to the last file of its record: so long `is_live` says so.

        Raises:
            OSError: if the lock cannot be had.
        """
        file = self.path / LIVE_FILE
        with file.open("wb") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            try:
                yield
            finally:
                file.unlink(missing_ok=True)

    @property
    def is_live(self) -> bool:
        """Whether the run goes on; one that is over, or was killed, does not."""
        try:
            with (self.path / LIVE_FILE).open("rb") as lock:
                fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except FileNotFoundError:
            return False
        except (BlockingIOError, PermissionError):
            return True
        return False

    @property
    def is_over(self) -> bool:
        """Whether it ended, well or not, with a word on how."""
        return (self.path / SUMMARY_FILE).exists()

    def log_path(self, process: str) -> Path:
        """Where the output of a process goes."""
        return self.path / LOG_FOLDER / f"{process}.log"

    def agent_folder(self, node: str) -> Path:
        """Where a node's agent keeps files of its own; made by the agent that does."""
        return self.path / AGENT_FOLDER / node

    def write(
        self,
        scenario: Scenario,
        endpoint: str,
        replay: Path | None = None,
        hosts: Mapping[str, Sequence[str]] | None = None,
        keyring: Keyring | None = None,
    ) -> RunInfo:
        """Write what the run's processes read; radios that the scenario names by file are copied."""
        groups = {name: list(nodes) for name, nodes in (hosts or {}).items()}
        repeated, secrets = str(replay.resolve()) if replay else "", str(keyring.path) if keyring else ""
        content, radios = with_radios_carried(scenario.model_dump(mode="json", by_alias=True), self.path)
        info = RunInfo(self.path.name, endpoint, os.getpid(), repeated, groups, secrets, radios)
        (self.path / SCENARIO_FILE).write_text(yaml_of(content), encoding="utf-8")
        (self.path / RUN_FILE).write_text(json.dumps(asdict(info)) + "\n", encoding="utf-8")
        return info

    @cached_property
    def info(self) -> RunInfo:
        """How to reach the run.

        Raises:
            OSError, ValueError: if the file is not there or not ours.
        """
        file, mistake = self.path / RUN_FILE, "not the description of a run"
        try:
            return RunInfo(**read_object(file, mistake))
        except TypeError as error:
            raise ValueError(f"{file}: {mistake}: {error}") from error

    def credentials(self, process: str) -> Credentials:
        """What a process of the run logs in to its router with.

        Raises:
            OSError, ValueError: they are not there or not ours.
        """
        return Keyring(Path(self.info.secrets)).credentials(process)

    @property
    def guard(self) -> RouterGuard:
        """What the run's router is opened with."""
        return RouterGuard(self.info.run, Keyring(Path(self.info.secrets)))

    @cached_property
    def keys(self) -> Keys:
        """The run's key space."""
        return Keys(self.info.run)

    @cached_property
    def scenario(self) -> Scenario:
        """The scenario as resolved, for the run's own processes.

        Raises:
            OSError, ValueError: if the file is not there or not ours.
        """
        origins: Mapping[str, str] = {}
        with suppress(OSError, ValueError):  # a record can be read without
            origins = self.info.radios
        return self._scenario(lambda content: with_radios_placed(content, self.path.absolute(), origins))

    def scenario_with(self, find: Find) -> Scenario:
        """The same for whoever reads the record: with the radios in it, and other files where they lie now.

        Raises:
            OSError, ValueError: as of `scenario`.
        """
        return self._scenario(lambda content: files_placed(content, self.path.absolute(), find))

    def _scenario(self, placed: Callable[[Any], Any]) -> Scenario:
        file = self.path / SCENARIO_FILE
        if not file.exists():
            raise ValueError(f"{self.path} is not the directory of a run (it has no {SCENARIO_FILE})")
        return read_recorded(file, placed)

    @property
    def summary(self) -> dict[str, Any]:
        """What the run said of itself at its end; empty if it did not come to write it.

        Raises:
            OSError, ValueError: the file cannot be read or is not ours.
        """
        file = self.path / SUMMARY_FILE
        return read_object(file, "not a summary") if file.exists() else {}


def live_runs(parent: Path) -> list[RunInfo]:
    """Runs below ``parent`` that go on, newest first."""
    found: list[RunInfo] = []
    for file in sorted(parent.glob(f"*/{RUN_FILE}"), reverse=True):
        run = RunDirectory(file.parent)
        with suppress(OSError, ValueError):
            if run.is_live:
                found.append(run.info)
    return found
