"""A run goes on as long as somebody flies it: not as long as a process of that number is there."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from bridge.run.access import NoAccess, access_of
from bridge.run.directory import LIVE_FILE, RUN_FILE, RunDirectory, live_runs

GOES_ON = """
import sys, time
from pathlib import Path
from bridge.run.directory import RunDirectory
with RunDirectory(Path(sys.argv[1])).going_on():
    print("goes on", flush=True)
    time.sleep(60)
"""


@pytest.fixture
def run(tmp_path: Path) -> RunDirectory:
    """One that this very process wrote, as `fly` does."""
    made = RunDirectory.create(tmp_path, "made")
    told = {"run": made.path.name, "endpoint": "tcp/127.0.0.1:1", "pid": os.getpid()}
    (made.path / RUN_FILE).write_text(json.dumps(told))
    return made


def test_a_run_is_over_though_its_process_lives_on(run: RunDirectory) -> None:
    with run.going_on():
        assert run.is_live
        assert [info.run for info in live_runs(run.path.parent)] == [run.path.name]
    assert not run.is_live
    assert live_runs(run.path.parent) == []
    assert not (run.path / LIVE_FILE).exists()
    with pytest.raises(NoAccess, match="is over"):
        access_of(run.path, "observer")


def test_a_flight_that_raises_is_over(run: RunDirectory) -> None:
    with pytest.raises(KeyboardInterrupt), run.going_on():
        raise KeyboardInterrupt
    assert not run.is_live


@pytest.mark.slow
def test_a_killed_run_is_over_whoever_has_its_number_now(run: RunDirectory) -> None:
    process = subprocess.Popen([sys.executable, "-c", GOES_ON, run.path], stdout=subprocess.PIPE)
    with process:
        assert process.stdout is not None
        process.stdout.readline()
        assert run.is_live
        process.send_signal(signal.SIGKILL)
    assert (run.path / LIVE_FILE).exists()
    assert not run.is_live


def test_a_path_that_is_no_utf8_is_refused_before_anything_is_flown(tmp_path: Path) -> None:
    """Parquet opens files by names in UTF-8 only: the run was flown, and its tables could not be written."""
    parent = Path(os.fsdecode(os.fsencode(tmp_path) + b"/d\xff"))
    with pytest.raises(OSError, match="is no path in UTF-8"):
        RunDirectory.create(parent, "made")
    assert not parent.exists()


def test_a_link_that_leads_nowhere_is_refused_by_its_name(tmp_path: Path) -> None:
    link = tmp_path / "link"
    link.symlink_to(tmp_path / "nowhere")
    with pytest.raises(FileExistsError) as told:
        RunDirectory.create(link, "separation")
    assert told.value.filename == str(link)


def test_a_path_that_the_locale_has_not_is_refused_before_anything_is_flown(tmp_path: Path) -> None:
    """Arrow and Zenoh take it in UTF-8, whatever the locale says."""
    made = "import sys; from pathlib import Path; from bridge.run.directory import RunDirectory\n"
    made += "RunDirectory.create(Path(sys.argv[1]), 'made')"
    posix = {"LC_ALL": "POSIX", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    done = subprocess.run(
        [sys.executable, "-c", made, tmp_path / "\u00f6"],
        env=os.environ | posix,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.stderr.splitlines()[-1].endswith(
        "\\xf6': paths are in ascii here: set LC_ALL=C.UTF-8, or name another"
    )
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("text", ["[" * 100_000, "[]", "5", '{"run": "x"}'])
def test_what_is_no_description_of_a_run_is_told_with_its_file(run: RunDirectory, text: str) -> None:
    (run.path / RUN_FILE).write_text(text)
    with pytest.raises(ValueError, match=f"{RUN_FILE}: not the description of a run"):
        _ = run.info
    with pytest.raises(NoAccess, match="is no run"):
        access_of(run.path, "observer")
