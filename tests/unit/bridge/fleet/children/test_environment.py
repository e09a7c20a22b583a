"""The environment of a run's processes."""

from __future__ import annotations

import subprocess
import sys
from ast import literal_eval
from pathlib import Path

import pytest

from bridge.fleet.children.child import Child, ProcessSpec
from bridge.fleet.children.environment import environment_of
from sitl_configs.own_code import path_of_others


def test_what_the_user_tunes_is_kept_but_for_the_vector_instructions() -> None:
    given = {"PATH": "/bin", "GLIBC_TUNABLES": "glibc.malloc.check=1:glibc.cpu.hwcaps=-SSE4_2"}
    found = environment_of(given)
    assert found["PATH"] == "/bin"
    assert found["PYTHONHASHSEED"] == "0"
    kept, hwcaps = found["GLIBC_TUNABLES"].split(":")
    assert kept == "glibc.malloc.check=1"
    assert {"-FMA", "-AVX2", "-FMA_Usable"} <= set(hwcaps.removeprefix("glibc.cpu.hwcaps=").split(","))


@pytest.mark.parametrize(
    "name", ["PX4_SIM_HOSTNAME", "PX4_SIM_MODEL", "PX4_SIM_SPEED_FACTOR", "replay", "replay_mode"]
)
async def test_what_the_shell_has_for_px4_does_not_reach_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.setenv(name, "elsewhere")
    monkeypatch.delenv("PX4_HOME", raising=False)  # kept: of whoever tries these tests with a real PX4
    log = tmp_path / "log"
    spec = ProcessSpec("px4", ["/usr/bin/env"], log, environment={"PX4_SYS_AUTOSTART": "10016"})
    await Child(spec).ended
    found = dict(line.split("=", 1) for line in log.read_text(encoding="utf-8").splitlines() if "=" in line)
    assert {key: found[key] for key in found if key.startswith("PX4_")} == {"PX4_SYS_AUTOSTART": "10016"}
    assert name not in found


async def test_it_imports_from_where_we_do_whatever_the_names_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "two\nlines"
    folder.mkdir()
    hooked = "__editable__.swarm-0.1.finder.__path_hook__"
    here = path_of_others()
    monkeypatch.setattr(
        sys, "path", [*here, str(folder), hooked, tmp_path]
    )  # what is no text is for no import
    log = tmp_path / "log"
    told = "import sys; from sitl_configs import own_code; print(sys.path)"
    await Child(ProcessSpec("ours", [sys.executable, "-P", "-c", told], log)).ended
    assert literal_eval(log.read_text(encoding="utf-8")) == [*here, str(folder), hooked]


def test_where_px4_is_reaches_the_runs_of_a_study() -> None:
    kept = environment_of({"PX4_HOME": "/there", "PX4_HOME_LAT": "47.0"})
    assert (kept["PX4_HOME"], kept.keys() & {"PX4_HOME_LAT"}) == ("/there", set())


SINES = (
    "import hashlib, math, struct; values = [math.sin(0.37 * n) * math.exp(1e-4 * n) for n in range(100000)]; "
    "print(hashlib.sha256(struct.pack('<100000d', *values)).hexdigest())"
)


def test_the_c_library_computes_alike_with_and_without_fused_multiply_add() -> None:
    digests = {
        subprocess.run(
            [sys.executable, "-c", SINES],
            env=environment_of({"GLIBC_TUNABLES": tunables}),
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for tunables in ("", "glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4,-AVX,-AVX512F", "glibc.cpu.hwcaps=-AVX512F")
    }
    assert len(digests) == 1
