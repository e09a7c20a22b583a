"""What made a record is written down, reads back, and what is other now is said in sentences."""

from __future__ import annotations

import hashlib
import subprocess
from dataclasses import replace
from importlib import metadata
from pathlib import Path

import pytest

from bridge.record import provenance
from bridge.record.provenance import (
    AutopilotOrigin,
    Provenance,
    _git_commit,
    ardupilot_origin,
    collect,
    differences,
    git_commit,
    px4_origin,
    read_provenance,
    standin_origin,
    write_provenance,
)

MADE = Provenance(
    lostlink="0.1.0",
    git_commit="abc",
    python="3.11.7",
    packages={"numpy": "2.3.0", "jsbsim": "1.2.0"},
    machine="Linux x86_64 glibc 2.36",
    cpu="Some CPU avx2 fma",
    environment={},
    autopilots={"0": AutopilotOrigin("ardupilot", "arducopter 4.6", "ab" * 32)},
    files={"/a/wander.py": "12" * 32},
)


def test_what_runs_here_is_told(tmp_path: Path) -> None:
    binary = tmp_path / "arducopter"
    binary.write_bytes(b"\x7fELF")
    files = [binary, tmp_path / "gone"]
    origins = {"0": standin_origin(), "1": ardupilot_origin(binary, "4.7")}
    found = collect(origins, files, {"networkx": "3.4"})
    assert found.packages["networkx"] == "3.4"
    assert found.files == {str(binary): hashlib.sha256(b"\x7fELF").hexdigest(), str(files[1]): ""}
    assert found.lostlink == metadata.version("lostlink")
    assert found.packages["numpy"] == metadata.version("numpy")
    assert all(found.packages.values())
    assert found.autopilots["0"] == AutopilotOrigin("standin", found.lostlink)
    assert found.autopilots["1"].sha256 == hashlib.sha256(b"\x7fELF").hexdigest()
    write_provenance(found, tmp_path)
    assert read_provenance(tmp_path) == found
    assert differences(found, found) == []


def test_environment_that_changes_numbers_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NPY_DISABLE_CPU_FEATURES", "X86_V4")
    monkeypatch.setenv("SOMETHING_ELSE", "secret")
    assert collect({}).environment["NPY_DISABLE_CPU_FEATURES"] == "X86_V4"
    assert "SOMETHING_ELSE" not in collect({}).environment


@pytest.mark.parametrize(
    ("new", "sentence"),
    [
        (replace(MADE, lostlink="0.2.0"), "warning: lostlink 0.1.0 made the record, this is 0.2.0"),
        (replace(MADE, git_commit=""), "warning: lostlink at commit abc made the record, this is (unknown)"),
        (
            replace(MADE, autopilots={"0": AutopilotOrigin("standin", "0.1.0")}),
            "warning: UA 0: ardupilot arducopter 4.6 binary with SHA-256 abababababab... made the record, "
            "this is standin 0.1.0",
        ),
        (
            replace(MADE, packages={"numpy": "2.3.0", "jsbsim": "1.3.0"}),
            "warning: jsbsim 1.2.0 made the record, this is 1.3.0",
        ),
        (
            replace(MADE, packages={"numpy": "2.4.0", "jsbsim": "1.2.0"}),
            "note: numpy 2.3.0 made the record, this is 2.4.0",
        ),
        (
            replace(MADE, packages=MADE.packages | {"networkx": "3.4"}),
            "warning: networkx (unknown) made the record, this is 3.4",
        ),
        (
            replace(MADE, files={"/a/wander.py": "34" * 32, "/a/novel.yaml": "56" * 32}),
            "warning: /a/wander.py is another than that of the record",
        ),
        (replace(MADE, python="3.12.1"), "note: Python 3.11.7 made the record, this is 3.12.1"),
        (
            replace(MADE, cpu="Other CPU"),
            "note: the record was made on the CPU Some CPU avx2 fma, this is Other CPU",
        ),
        (
            replace(MADE, environment={"GLIBC_TUNABLES": "x=y"}),
            "note: GLIBC_TUNABLES was unset when the record was made, this is x=y",
        ),
    ],
)
def test_each_difference_is_a_sentence(new: Provenance, sentence: str) -> None:
    assert differences(MADE, new) == [sentence]


def test_warnings_come_before_notes() -> None:
    told = differences(MADE, Provenance())
    assert [line.split(":")[0] for line in told] == ["warning"] * 4 + ["note"] * 4


def test_other_binary_of_the_same_version_is_told() -> None:
    other = AutopilotOrigin("ardupilot", "arducopter 4.6", "ab" * 31 + "cd")
    assert len(differences(MADE, replace(MADE, autopilots={"0": other}))) == 1


def test_files_of_other_versions_are_read_and_garbage_is_refused(tmp_path: Path) -> None:
    assert read_provenance(tmp_path) is None
    file = tmp_path / "provenance.json"
    file.write_text('{"lostlink": "9", "novel": [1]}')
    assert read_provenance(tmp_path) == Provenance(lostlink="9")
    for text in ("", "[]", '{"packages": 3}', '{"autopilots": {"0": 1}}', "[" * 100_000):
        file.write_text(text)
        with pytest.raises(ValueError, match=r"provenance\.json: not a description"):
            read_provenance(tmp_path)


def test_commit_of_a_checkout_and_none_elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert _git_commit(tmp_path) == ""
    git = ["git", "-C", str(tmp_path), "-c", "user.name=n", "-c", "user.email=e@example.org"]
    subprocess.run([*git, "init", "-q"], check=True)
    assert _git_commit(tmp_path) == ""
    ours = tmp_path / "channel"
    ours.mkdir()
    (ours / "f").write_text("1")
    (tmp_path / ".gitignore").write_text("*.pyc\n")
    subprocess.run([*git, "add", "."], check=True)
    subprocess.run([*git, "commit", "-qm", "m"], check=True)
    commit = subprocess.run(
        [*git, "rev-parse", "HEAD"], check=True, capture_output=True, text=True
    ).stdout.strip()
    (ours / "f.pyc").write_text("made of it")
    (tmp_path / "study.yaml").write_text("a user's")
    (tmp_path / ".gitignore").write_text("*.pyc\nruns/\n")  # none of what flies
    assert _git_commit(tmp_path) == commit
    (ours / "f").write_text("2")
    first = _git_commit(tmp_path)
    (ours / "f").write_text("3")
    second = _git_commit(tmp_path)
    (ours / "new").write_text("1")
    third = _git_commit(tmp_path)
    (ours / "new").write_text("2")
    fourth = _git_commit(tmp_path)
    assert all(text.startswith(f"{commit}-dirty-") for text in (first, second, third, fourth))
    assert len({first, second, third, fourth}) == 4
    (ours / "new").unlink()
    (ours / "f").write_text("2")
    assert _git_commit(tmp_path) == first
    with monkeypatch.context() as hook:
        hook.setenv("GIT_DIR", str(tmp_path / "other"))
        hook.setenv("GIT_INDEX_FILE", str(tmp_path / "other" / "index"))
        assert _git_commit(tmp_path) == first
    monkeypatch.setattr(
        provenance, "_git", lambda _, what, *__: commit.encode() if what == "rev-parse" else None
    )
    assert _git_commit(tmp_path) == f"{commit}-dirty"  # slow


def test_a_process_looks_once_for_the_commit_of_what_it_has_imported(monkeypatch: pytest.MonkeyPatch) -> None:
    now = git_commit()
    monkeypatch.setattr(provenance, "_git_commit", lambda _root: "f" * 40)
    assert collect({}).git_commit == now


def test_the_version_of_a_px4_is_what_its_build_says(tmp_path: Path) -> None:
    binary = tmp_path / "bin" / "px4"
    binary.parent.mkdir()
    binary.write_bytes(b"px4")
    assert px4_origin(binary) == AutopilotOrigin("px4", "", hashlib.sha256(b"px4").hexdigest(), str(binary))
    header = tmp_path / "src" / "lib" / "version" / "build_git_version.h"
    header.parent.mkdir(parents=True)
    header.write_text(
        """/* as PX4 1.16 makes it */
#define PX4_GIT_VERSION_STR "ea191a37766d374483ca7bd5a8aa428cd515c75f"
#define PX4_GIT_VERSION_BINARY 0xea191a37766d3744
#define PX4_GIT_TAG_STR "v1.16.0-alpha1"
#define PX4_GIT_OEM_VERSION_STR  ""
""",
        encoding="utf-8",
    )
    assert px4_origin(binary).version == "v1.16.0-alpha1 ea191a3776"
