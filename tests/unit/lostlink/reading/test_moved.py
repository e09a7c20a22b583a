"""Files that a record names are found where they lie now, by the ends of their paths and by content."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from bridge.record.provenance import collect, write_provenance
from lostlink.reading.moved import Moved


@pytest.fixture
def handed_in(tmp_path: Path) -> Path:
    """A folder with code and a run, which lay elsewhere when that was flown."""
    work = tmp_path / "work"
    (work / "agents").mkdir(parents=True)
    (work / "runs" / "A").mkdir(parents=True)
    (work / "agents" / "swarm.py").write_text("import law\n")
    (work / "agents" / "law.py").write_text("GAIN = 1\n")
    write_provenance(
        collect({}, [work / "agents" / "swarm.py", work / "agents" / "law.py"]), work / "runs" / "A"
    )
    (tmp_path / "unzipped").mkdir()
    return work.rename(tmp_path / "unzipped" / "work of ann")


def named(tmp_path: Path) -> str:
    return f"{tmp_path}/work/agents/swarm.py:Mine"


def test_a_file_is_found_around_the_run(handed_in: Path, tmp_path: Path) -> None:
    moved = Moved(handed_in / "runs" / "A")
    assert moved.find(named(tmp_path)) == f"{handed_in}/agents/swarm.py:Mine"
    assert moved.folders == {tmp_path / "work": handed_in}
    law = str(tmp_path / "work" / "agents" / "law.py")
    assert moved.renamed({law: "1", "/usr/x.py": "2"}) == {
        f"{handed_in}/agents/law.py": "1",
        "/usr/x.py": "2",
    }


def test_what_is_still_there_is_not_looked_for(handed_in: Path, tmp_path: Path) -> None:
    shutil.copytree(handed_in, tmp_path / "work")
    moved = Moved(handed_in / "runs" / "A", handed_in)
    assert (moved.find(named(tmp_path)), moved.found, moved.missing) == (named(tmp_path), {}, {})


def test_a_file_of_other_content_counts_only_where_the_user_says_so(handed_in: Path, tmp_path: Path) -> None:
    run, swarm = handed_in / "runs" / "A", Path("agents", "swarm.py")
    (handed_in / swarm).write_text("import law  # other\n")
    moved = Moved(run)
    assert (moved.find(named(tmp_path)), [*moved.missing]) == (named(tmp_path), [tmp_path / "work" / swarm])
    for folder in (handed_in, handed_in / "agents", tmp_path / "unzipped"):
        same = Moved(run, folder).find(named(tmp_path))
        assert same == (named(tmp_path) if folder.name == "unzipped" else f"{handed_in / swarm}:Mine")


def test_a_file_is_found_where_the_user_is(
    handed_in: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = shutil.move(handed_in / "runs" / "A", tmp_path / "A")
    assert Moved(run).find(named(tmp_path)) == named(tmp_path)
    monkeypatch.chdir(handed_in)
    assert Moved(run).find(named(tmp_path)) == f"{handed_in}/agents/swarm.py:Mine"


def test_what_may_not_be_read_is_not_found(
    handed_in: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As in the home of another user: `Path.is_file` raises there, and reading was the end of it."""

    def refuse(*_: object) -> bool:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "is_file", refuse)
    monkeypatch.setattr("bridge.record.digests.file_digest", refuse)
    moved = Moved(handed_in / "runs" / "A")
    assert moved.find(named(tmp_path)) == named(tmp_path)
    assert [*moved.missing] == [tmp_path / "work" / "agents" / "swarm.py"]
