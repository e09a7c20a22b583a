"""`--px4-dir`: it reaches whoever starts PX4, and nobody else."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest
from click.testing import CliRunner

from bridge.fleet.course import FleetError
from fdm.exchange.px4 import watched
from lostlink.cli.flying.run import run
from lostlink.cli.live.doctor import doctor
from lostlink.flight.scripted import fly
from lostlink.plan import machine

BINARY = "build/px4_sitl_default/bin/px4"


@pytest.fixture(autouse=True)
def no_px4(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("PX4_HOME", raising=False)
    monkeypatch.setenv("PATH", os.defpath)


def test_doctor_finds_px4_where_it_was_said_to_be_and_forgets_it(px4_home: Path) -> None:
    told = json.loads(CliRunner().invoke(doctor, ["--json", "--px4-dir", str(px4_home)]).stdout)
    assert told["autopilots"]["px4"] == str(px4_home / BINARY)
    assert "PX4_HOME" not in os.environ
    without = CliRunner().invoke(doctor, [])
    assert "px4            not found (--px4-dir DIR, PX4_HOME or PATH)" in without.stdout


def test_doctor_says_why_its_flights_may_not_repeat_here(
    px4_home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(pid: int, policy: int, parameter: os.sched_param) -> None:
        raise PermissionError

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    monkeypatch.setattr(watched, "shows_rest", lambda: False)
    told = CliRunner().invoke(doctor, ["--px4-dir", str(px4_home)]).stdout
    assert "  px4 may not repeat here: this system does not show when threads run" in told
    assert "  px4 may not repeat here: its PX4 may not have real-time threads (root, CAP_SYS_NICE" in told
    assert "repeat here" not in CliRunner().invoke(doctor, []).stdout, "there is no PX4"


def test_doctor_says_that_its_flights_can_repeat_and_which_px4_it_is(
    px4_home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(machine, "why_not_here", list)
    told = CliRunner().invoke(doctor, ["--px4-dir", str(px4_home)]).stdout
    assert "  px4 version: not known" in told
    assert "  px4 can repeat here: " in told
    header = px4_home / BINARY.removesuffix("bin/px4") / "src/lib/version/build_git_version.h"
    header.parent.mkdir(parents=True)
    header.write_text('#define PX4_GIT_TAG_STR "v1.16.0"\n#define PX4_GIT_VERSION_STR "0123456789abcdef"\n')
    assert (
        "  px4 version: v1.16.0 0123456789\n"
        in CliRunner().invoke(doctor, ["--px4-dir", str(px4_home)]).stdout
    )


def test_a_run_looks_there_first(tmp_path: Path) -> None:
    words = ["--autopilot", "px4", "--px4-dir", str(tmp_path), "--out", str(tmp_path / "runs")]
    done = CliRunner().invoke(run, [*words, "--first-slot", "auto"])
    assert done.exit_code == 2
    assert f"no PX4 was found. Looked at:\nlostlink:   {tmp_path}/bin/px4\n" in done.stderr


def test_so_does_a_script(tmp_path: Path) -> None:
    with pytest.raises(FleetError, match=f"no PX4 was found. Looked at:\n  {tmp_path}/bin/px4\n"):
        fly("separation", autopilot="px4", px4_dir=tmp_path, directory=tmp_path, first_slot="auto")
