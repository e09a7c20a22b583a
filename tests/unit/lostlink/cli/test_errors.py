"""All errors of the command begin alike."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import lostlink
from bridge.record.provenance import collect, write_provenance
from lostlink.cli.main import main
from tests.unit.lostlink.replay.flown import flown, scenario_of
from tests.warm import Command


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["run", "--sett", "x=1"], "lostlink: No such option"),
        (["runn"], "lostlink: there is no command 'runn'; did you mean run? (lostlink --help lists them)"),
        (["export", "/nowhere"], "lostlink: Invalid value for 'RUN'"),
        (
            ["check", "seperation"],
            "lostlink: seperation: no such file, and no scenario of that name; did you mean",
        ),
        (["run", "--set", "a"], "lostlink: --set a: has to be KEY=VALUE"),
    ],
)
def test_errors_begin_with_the_commands_name(
    arguments: list[str], says: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["lostlink", *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    told = capsys.readouterr().err
    assert ended.value.code == 2
    assert told.startswith(says)
    assert "Error:" not in told


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full")
def test_output_to_a_full_disk_is_told_and_ends_with_1() -> None:
    """By Python's own end, which writes once more what could not be written: its status would be 120."""
    with Path("/dev/full").open("w", encoding="utf-8") as full:
        done = subprocess.run(
            [sys.executable, "-m", "lostlink", "radios"],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            timeout=60,
            check=False,
        )
    told = "lostlink: [Errno 28] No space left on device: where its output goes to, or the run is\n"
    assert (done.returncode, done.stderr) == (1, told)


def test_output_that_is_cut_off_is_told_also_where_python_has_no_buffer(tmp_path: Path) -> None:
    """As in most containers (PYTHONUNBUFFERED): the first part went to the file, the rest nowhere, with status 0."""
    with (tmp_path / "schema.json").open("wb") as file:
        done = subprocess.run(
            ["sh", "-c", 'ulimit -f 8; exec "$0" "$@"', sys.executable, "-Bum", "lostlink", "schema"],
            stdout=file,
            stderr=subprocess.PIPE,
            text=True,
            timeout=60,
            check=False,
        )
    told = "lostlink: [Errno 27] File too large: where its output goes to, or the run is\n"
    assert (done.returncode, done.stderr) == (1, told)


def test_help_ends_well(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(sys, "argv", ["lostlink", "--help"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code in (0, None)
    assert "check" in capsys.readouterr().out


@pytest.mark.parametrize(
    "arguments", [("judge",), ("compare", "--metrics"), ("report",), ("export", "--csv")]
)
@pytest.mark.slow
def test_an_output_that_nobody_reads_ends_a_command_quietly(arguments: tuple[str, ...], tmp_path: Path):
    run = flown(tmp_path / "made", scenario_of("moon2020", ("0", "1")))
    write_provenance(collect({}), run)
    reads, writes = os.pipe()
    os.close(reads)
    ended = Command(*arguments, run, stdout=writes, stderr=subprocess.PIPE, text=True)
    os.close(writes)
    _, said = ended.communicate(timeout=60)
    told = [line for line in said.splitlines() if not line.startswith("report: ")]
    assert (ended.returncode, told) == (141, [])


@pytest.mark.parametrize(
    "arguments",
    [("runn",)]
    + [
        pytest.param(each, marks=pytest.mark.slow)
        for each in (("--help",), ("--version",), ("link", "--help"), ("run", "--sett", "x"))
    ],
)
def test_a_help_and_a_mistake_that_nobody_reads_end_likewise(arguments: tuple[str, ...]):
    reads, writes = os.pipe()
    os.close(reads)
    command = [sys.executable, "-m", "lostlink", *arguments]
    ended = subprocess.run(command, stdout=writes, stderr=writes, check=False)
    os.close(writes)
    assert ended.returncode == 141


@pytest.mark.slow
@pytest.mark.parametrize("encoding", ["ascii", "latin-1"])
def test_characters_that_a_terminal_has_not_end_no_command(encoding: str, tmp_path: Path):
    extra = "expectations: [{type: ending, ending: done, name: 'n\u00e4her \u20ac'}]\n"
    run = flown(tmp_path / "made", scenario_of("moon2020", ("0", "1"), extra=extra))
    environment = {**os.environ, "PYTHONIOENCODING": encoding, "PYTHONUTF8": "0"}
    for arguments, says in ((["judge"], "her "), (["compare", "--metrics"], "| digest")):
        command = [sys.executable, "-m", "lostlink", *arguments, str(run)]
        ended = subprocess.run(command, capture_output=True, env=environment, check=False)
        assert b"Traceback" not in ended.stderr
        assert says in ended.stdout.decode(encoding, errors="replace")


def test_python_m_imports_no_agents_from_the_working_directory_as_the_command_does(tmp_path: Path):
    (tmp_path / "flock.py").write_text("from lostlink import Agent\n\n\nclass Flock(Agent):\n    pass\n")
    scenario, home = tmp_path / "scenarios" / "flock.yaml", "{lat_deg: 40, lon_deg: -105, alt_amsl_m: 1600}"
    scenario.parent.mkdir()
    scenario.write_text(
        f"schema: 1\nname: flock\nduration_s: 1\norigin: {home}\nradio: perfect\n"
        "nodes: [{id: 0, agent: {type: own, class: 'flock:Flock'}}]\n"
    )
    command = [sys.executable, "-m", "lostlink", "check", str(scenario)]
    environment = {**os.environ, "PYTHONPATH": str(Path(lostlink.__file__).parents[1])}
    ended = subprocess.run(command, capture_output=True, cwd=tmp_path, env=environment, check=False)
    assert ended.returncode == 2
    assert f"flock lies in {tmp_path}, which is not on PYTHONPATH" in ended.stderr.decode()
