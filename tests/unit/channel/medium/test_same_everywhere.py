"""The record does not depend on the instructions that numpy and the C library choose."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

WORKLOAD = Path(__file__).with_name("workload.py")
ROOT = Path(__file__).parents[4]
NPY, GLIBC = "NPY_DISABLE_CPU_FEATURES", "GLIBC_TUNABLES"
NO_FMA = {GLIBC: "glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4,-AVX,-AVX512F"}
SETTINGS = [
    pytest.param(
        {NPY: "X86_V3 X86_V4 AVX512_ICL AVX512_SPR"} | NO_FMA,
        id="no AVX2 in numpy, no FMA in the C library",
        marks=pytest.mark.slow,
    ),
    pytest.param({NPY: "X86_V4 AVX512_ICL AVX512_SPR"}, id="no AVX-512 in numpy", marks=pytest.mark.long),
    pytest.param(NO_FMA, id="no FMA in the C library", marks=[pytest.mark.slow, pytest.mark.long]),
]
"""Features that a numpy or a processor does not have are left out with a warning, which changes nothing."""


def digests(settings):
    """Digest by radio, from a Python of its own."""
    plain = {key: value for key, value in os.environ.items() if key not in (NPY, GLIBC)}
    done = subprocess.run(
        [sys.executable, "-W", "ignore", WORKLOAD],
        env=plain | settings | {"PYTHONPATH": str(ROOT)},
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    return dict(line.split(" ", 1) for line in done.stdout.splitlines())


@pytest.fixture(scope="module")
def as_it_comes():
    return digests({})


@pytest.mark.parametrize("settings", SETTINGS)
def test_the_record_is_the_same(settings, as_it_comes):
    assert digests(settings) == as_it_comes


@pytest.mark.slow
def test_the_workload_has_both_fates_of_most_radios(as_it_comes):
    counts = [tuple(map(int, line.split()[:2])) for line in as_it_comes.values()]
    assert len(counts) == 39
    assert sum(receptions for receptions, _ in counts) > 6000
    assert sum(0 < arrived < receptions for receptions, arrived in counts) >= 20
