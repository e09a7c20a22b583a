"""What a record was made with: versions, machine and autopilots. Flown again with others, a run may differ."""

from __future__ import annotations

import hashlib
import json
import os
import platform
import re
import subprocess
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from functools import cache
from importlib import metadata
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, Literal

from bridge.record.digests import digest_if_readable, file_digest
from bridge.record.names import PROVENANCE_FILE
from sitl_configs.own_code import OURS

PACKAGES: Final = ("numpy", "scipy", "jsbsim", "pymavlink", "eclipse-zenoh", "pyarrow")
SERIOUS: Final = ("jsbsim",)
"""Packages whose version changes flights in more than last bits."""
VARIABLES: Final = ("NPY_DISABLE_CPU_FEATURES", "GLIBC_TUNABLES")
"""What changes the code paths of numpy and of the C library's functions."""
CPU_FLAGS: Final = (
    "sse4_2",
    "avx",
    "fma",
    "avx2",
    "avx512f",
    "avx512_vnni",
    "amx_tile",
    "asimd",
    "sve",
    "sve2",
)
NONE: Final[Mapping[str, str]] = MappingProxyType({})
UNKNOWN: Final = "(unknown)"
GIT_TIMEOUT_S: Final = 10.0
_ROOT: Final = Path(__file__).resolve().parents[2]


@dataclass(frozen=True, slots=True)
class AutopilotOrigin:
    """What flew one UA.

    Attributes:
        source: as in the scenario: ardupilot, standin or external.
        version: its version text; "" if not known.
        sha256: of the binary; "" if there is none of ours.
        path: of the binary; where it lies makes no difference.
    """

    source: str
    version: str = ""
    sha256: str = ""
    path: str = field(default="", compare=False)

    def __str__(self) -> str:
        digest = f"binary with SHA-256 {self.sha256[:12]}..." if self.sha256 else ""
        return " ".join(part for part in (self.source, self.version, digest) if part)


@dataclass(frozen=True, slots=True)
class Provenance:
    """What a record was made with; "" for what is not known.

    Attributes:
        lostlink: version.
        git_commit: if it is a checkout; with changes of its packages followed by "-dirty-" and the beginning of their
            SHA-256: of `git diff HEAD` and of new files.
        python: version.
        packages: version by name, "" if not installed.
        machine: operating system, C library and architecture.
        cpu: model and the features that numbers may depend on.
        environment: variables that change which code computes numbers, if set.
        autopilots: by node id.
        files: SHA-256 of what the scenario names, and what these import, by path.
    """

    lostlink: str = ""
    git_commit: str = ""
    python: str = ""
    packages: dict[str, str] = field(default_factory=dict)
    machine: str = ""
    cpu: str = ""
    environment: dict[str, str] = field(default_factory=dict)
    autopilots: dict[str, AutopilotOrigin] = field(default_factory=dict)
    files: dict[str, str] = field(default_factory=dict)

    @property
    def made_by(self) -> str:
        """Which lostlink, for people."""
        return lostlink_told(self.lostlink, self.git_commit)


def collect(
    autopilots: Mapping[str, AutopilotOrigin],
    files: Iterable[Path] = (),
    packages: Mapping[str, str] = NONE,
) -> Provenance:
    """What this process runs with.

    Args:
        autopilots: by node id; see `ardupilot_origin` and `standin_origin`.
        files: what the scenario names, and what these import.
        packages: versions, by name, of installed ones that these import.
    """
    return Provenance(
        lostlink=version_of("lostlink"),
        git_commit=git_commit(),
        python=platform.python_version(),
        packages={name: version_of(name) for name in PACKAGES} | dict(packages),
        machine=f"{platform.system()} {platform.machine()} {' '.join(platform.libc_ver())}".strip(),
        cpu=_cpu(),
        environment={name: os.environ[name] for name in VARIABLES if name in os.environ},
        autopilots=dict(autopilots),
        files={str(path): digest_if_readable(path) for path in files},
    )


def ardupilot_origin(binary: Path, version: str = "") -> AutopilotOrigin:
    """Of a real ArduPilot: the digest of its binary, and its version text if that is known.

    Raises:
        OSError: the binary cannot be read.
    """
    return AutopilotOrigin("ardupilot", version, file_digest(binary), str(binary))


def px4_origin(binary: Path) -> AutopilotOrigin:
    """Of a real PX4: the digest of its binary, and its version if its build is there to tell.

    Raises:
        OSError: the binary cannot be read.
    """
    return AutopilotOrigin("px4", px4_version(binary), file_digest(binary), str(binary))


def px4_version(binary: Path) -> str:
    """Tag and commit by the header that PX4's build makes; empty: only the binary is there."""
    header = binary.parents[1] / "src" / "lib" / "version" / "build_git_version.h"
    try:
        text = header.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""
    found = dict(re.findall(r'#define PX4_GIT_(TAG|VERSION)_STR +"([^"]*)"', text))
    return " ".join(value for value in (found.get("TAG", ""), found.get("VERSION", "")[:10]) if value)


def standin_origin() -> AutopilotOrigin:
    """Of the stand-in, which has our version."""
    return AutopilotOrigin("standin", version_of("lostlink"))


def write_provenance(provenance: Provenance, run: Path) -> None:
    """Write `provenance.json` into the run directory ``run``.

    Raises:
        OSError: it cannot be written.
    """
    (run / PROVENANCE_FILE).write_text(json.dumps(asdict(provenance), indent=1) + "\n", encoding="utf-8")


def read_provenance(run: Path) -> Provenance | None:
    """What the record in ``run`` was made with; None if it does not say. Keys of other versions are passed over.

    Raises:
        ValueError: the file is not ours; the text names it.
        OSError: it cannot be read.
    """
    path = run / PROVENANCE_FILE
    if not path.exists():
        return None
    try:
        return _from_plain(json.loads(path.read_text(encoding="utf-8")))
    except (ValueError, TypeError, AttributeError, RecursionError) as error:
        raise ValueError(f"{path}: not a description of what made a record: {error}") from error


@contextmanager
def version_noted(*runs: Path) -> Iterator[None]:
    """Of a ValueError meanwhile that another version has made the records in ``runs``, if so, as notes of the error."""
    try:
        yield
    except ValueError as error:
        for note in filter(None, map(_other_version, runs)):
            if note not in getattr(error, "__notes__", ()):
                error.add_note(note)
        raise


def _other_version(run: Path) -> str:
    """Which version made a record, in words; "" if it is this one, or not known."""
    try:
        made = read_provenance(run)
    except (OSError, ValueError):
        return ""
    ours = lostlink_told(version_of("lostlink"), git_commit())
    if made is None or made.made_by == ours:
        return ""
    return f"{run}: another version has made this record: {made.made_by}; this is {ours}"


def _from_plain(content: Any) -> Provenance:
    return Provenance(
        lostlink=str(content.get("lostlink", "")),
        git_commit=str(content.get("git_commit", "")),
        python=str(content.get("python", "")),
        packages=_table(content.get("packages", {})),
        machine=str(content.get("machine", "")),
        cpu=str(content.get("cpu", "")),
        environment=_table(content.get("environment", {})),
        autopilots={node: _origin(values) for node, values in content.get("autopilots", {}).items()},
        files=_table(content.get("files", {})),
    )


def _origin(values: Any) -> AutopilotOrigin:
    return AutopilotOrigin(*(str(values.get(name, "")) for name in ("source", "version", "sha256", "path")))


def _table(values: Any) -> dict[str, str]:
    return {str(name): str(value) for name, value in values.items()}


def files_changed_since(made: Provenance) -> list[str]:
    """Paths of its files that are others now, or gone."""
    return [path for path, digest in made.files.items() if digest_if_readable(Path(path)) != digest]


def differences(old: Provenance, new: Provenance) -> list[str]:
    """What is other now than when the record was made, as sentences.

    Each begins with ``warning: `` if flights are expected to differ for it, or ``note: `` if only last bits may.
    """
    return [f"{level}: {text}" for level, text in sorted(_changes(old, new), key=lambda c: c[0] != "warning")]


def _changes(old: Provenance, new: Provenance) -> Iterator[tuple[Literal["warning", "note"], str]]:
    if old.lostlink != new.lostlink:
        yield "warning", _made("lostlink", old.lostlink, new.lostlink)
    if old.git_commit != new.git_commit:
        yield "warning", _made("lostlink at commit", old.git_commit, new.git_commit)
    for node in sorted(old.autopilots.keys() | new.autopilots.keys()):
        before, now = (str(side.autopilots.get(node, "")) for side in (old, new))
        if before != now or _sha256(old, node) != _sha256(new, node):
            yield "warning", _made(f"UA {node}:", before, now)
    for path in sorted(old.files.keys() & new.files.keys()):
        if old.files[path] != new.files[path]:
            yield "warning", f"{path} is another than that of the record"
    for name in sorted(old.packages.keys() | new.packages.keys()):
        before, now = old.packages.get(name, ""), new.packages.get(name, "")
        if before != now:
            is_own = name not in PACKAGES  # imported by the user's code, which may decide by it
            yield "warning" if is_own or name in SERIOUS else "note", _made(name, before, now)
    if old.python != new.python:
        yield "note", _made("Python", old.python, new.python)
    for what, before, now in (("machine", old.machine, new.machine), ("CPU", old.cpu, new.cpu)):
        if before != now:
            yield "note", f"the record was made on the {what} {before or UNKNOWN}, this is {now or UNKNOWN}"
    for name in sorted(old.environment.keys() | new.environment.keys()):
        before, now = (side.environment.get(name, "unset") for side in (old, new))
        if before != now:
            yield "note", f"{name} was {before} when the record was made, this is {now}"


def _sha256(side: Provenance, node: str) -> str:
    origin = side.autopilots.get(node)
    return origin.sha256 if origin is not None else ""


def _made(what: str, old: str, new: str) -> str:
    return f"{what} {old or UNKNOWN} made the record, this is {new or UNKNOWN}"


def version_of(package: str) -> str:
    """The version of an installed package; "" if it is not installed."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return ""


def made_by(run: Path) -> str:
    """Which lostlink made the record in ``run``, for people.

    Raises:
        OSError, ValueError: what made the record cannot be read.
    """
    made = read_provenance(run)
    return "it is not known what" if made is None else made.made_by


def lostlink_told(version: str, commit: str) -> str:
    """Which lostlink, for people."""
    return f"lostlink {version or UNKNOWN}{commit and f' at commit {commit}'}"


@cache
def git_commit() -> str:
    """`Provenance.git_commit` of this process, which looks once: later changes are none of what it has imported."""
    return _git_commit(_ROOT)


def _git_commit(root: Path) -> str:
    """The commit of a checkout, and which changes its packages have; "" if it is none, or git is not there or slow."""
    if not (root / ".git").exists():
        return ""
    commit = (_git(root, "rev-parse", "HEAD") or b"").decode().strip()
    if not commit:
        return ""
    ours = ("--", *sorted(OURS))
    changes = _git(root, "diff", "HEAD", "--binary", "--no-color", "--no-ext-diff", "--no-textconv", *ours)
    new = _git(root, "ls-files", "--others", "--exclude-standard", "-z", *ours)
    if changes is None or new is None:
        return f"{commit}-dirty"  # for all that is known
    digest = hashlib.sha256(changes)
    for name in filter(None, new.split(b"\0")):
        digest.update(name + digest_if_readable(root / os.fsdecode(name)).encode())
    return f"{commit}-dirty-{digest.hexdigest()[:12]}" if changes or new else commit


def _git(root: Path, *arguments: str) -> bytes | None:
    """What git says of a checkout, whichever a hook that we run in is about; None if it fails or is slow."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith("GIT_")}
    environment["GIT_OPTIONAL_LOCKS"] = "0"  # nobody's commit meets a lock of ours
    try:
        return subprocess.run(
            ["git", "-C", str(root), *arguments],
            capture_output=True,
            timeout=GIT_TIMEOUT_S,
            check=True,
            env=environment,
        ).stdout
    except (OSError, subprocess.SubprocessError):
        return None


def _cpu() -> str:
    """Model and features; on anything but Linux, what Python knows."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").split("\n\n", 1)[0]
    except OSError:
        return platform.processor()
    fields = dict(_pair(line) for line in lines.splitlines() if ":" in line)
    flags = set(fields.get("flags", fields.get("Features", "")).split())
    model = fields.get("model name", platform.processor())
    return " ".join([model, *(flag for flag in CPU_FLAGS if flag in flags)]).strip()


def _pair(line: str) -> tuple[str, str]:
    name, _, value = line.partition(":")
    return name.strip(), value.strip()
