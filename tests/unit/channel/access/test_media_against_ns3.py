"""lostlink's DCF against what ns-3 3.37 computed (tests/data/ns3_dcf.csv, by `python -m benchmarks ns3`)."""

from __future__ import annotations

import csv
from dataclasses import replace
from math import hypot
from pathlib import Path
from statistics import fmean

import pytest

from benchmarks.channel import bench_ns3
from benchmarks.channel.bench_ns3 import Mean
from benchmarks.channel.ns3 import ours, theirs
from benchmarks.channel.ns3.settings import SETTINGS, Setting, figures_of

DATA = Path(__file__).parents[3] / "data" / "ns3_dcf.csv"
QUICK_SEEDS, SEEDS = 2, 8
QUICK = ("broadcast, 2 saturated", "hidden pair", "errors")
DIFFER = {("capture, 5 dB", "from 33 m")}
"""lostlink goes over to the stronger frame at any time, ns-3 in the first 16 us alone."""
SIGMAS = 4.0
RARE = 1e-3
"""Of a figure: where none, or one, of ns-3's packets was lost, its seeds do not scatter."""
MODELS = {"errors": 5e-3, "moving receiver": 5e-3}
"""Of a figure: ns-3's headers, tails and pad bits can fail, too; lostlink's have no bits of their own."""


def recorded() -> dict[str, dict[tuple[str, str], tuple[Mean, int]]]:
    """ns-3's figures, with how many seeds they are of, by setting, group and name."""
    found: dict[str, dict[tuple[str, str], tuple[Mean, int]]] = {}
    with DATA.open() as file:
        for row in csv.DictReader(line for line in file if not line.startswith("#")):
            mean = Mean(float(row["mean"]), float(row["standard_error"]))
            found.setdefault(row["setting"], {})[row["group"], row["figure"]] = (mean, int(row["seeds"]))
    return found


RECORDED = recorded()


def means(setting: Setting, seeds: int) -> dict[tuple[str, str], float]:
    """lostlink's figures."""
    runs = [figures_of(ours.run(setting, seed), setting) for seed in range(1, seeds + 1)]
    return {key: fmean(run[key] for run in runs) for key in runs[0]}


def hold(name: str, seeds: int, setting: Setting | None = None) -> None:
    """Four standard errors of the difference, as many seeds here scattering as much as those of ns-3."""
    found = means(setting or SETTINGS[name], seeds)
    assert found.keys() == RECORDED[name].keys()
    for (group, figure), (ns3, ns3_seeds) in RECORDED[name].items():
        if (name, group) not in DIFFER:
            error = ns3.standard_error * hypot(1.0, (ns3_seeds / seeds) ** 0.5)
            bound = SIGMAS * error + (RARE + MODELS.get(name, 0.0)) * ns3.value
            assert found[group, figure] == pytest.approx(ns3.value, abs=bound), (group, figure)


def test_every_setting_is_recorded() -> None:
    assert RECORDED.keys() == SETTINGS.keys()


@pytest.mark.slow
@pytest.mark.parametrize("name", QUICK)
def test_settings_in_short(name: str) -> None:
    hold(name, QUICK_SEEDS)


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("name", SETTINGS)
def test_all_settings(name: str) -> None:
    hold(name, SEEDS)


@pytest.mark.slow
def test_bounds_tell_other_stations() -> None:
    """Ten that do not wait EIFS collide more often than ns-3's ten that do, though only half a second is looked at."""
    name = "broadcast, 10 saturated, EIFS"
    short = replace(SETTINGS[name], seconds=0.5)
    hold(name, QUICK_SEEDS, short)
    with pytest.raises(AssertionError, match=r"received per frame|carried"):
        hold(name, QUICK_SEEDS, replace(short, uses_eifs=False))


@pytest.mark.slow
def test_bounds_tell_when_a_carrier_is_sensed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Sensed at once, fewer of twenty broadcasters collide."""
    monkeypatch.setattr(ours, "CCA_NS", 0)
    with pytest.raises(AssertionError, match="received of offered"):
        hold("broadcast, 20 at 50 a second", SEEDS)


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """ns-3's side."""
    lacking = theirs.missing()
    if lacking is not None:
        pytest.skip(lacking)
    return theirs.build(tmp_path_factory.mktemp("ns3"))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["errors", "moving receiver"])
def test_ns3_is_as_recorded(name: str, program: Path) -> None:
    """The same seeds give the same figures; here with another number of them."""
    setting = SETTINGS[name]
    runs = [figures_of(counts, setting) for counts in theirs.run(program, setting, 4)]
    for key, (ns3, seeds) in RECORDED[name].items():
        error = ns3.standard_error * hypot(1.0, (seeds / 4) ** 0.5)
        assert fmean(run[key] for run in runs) == pytest.approx(ns3.value, abs=SIGMAS * error + 1e-9)


def test_without_ns3_the_benchmark_says_so(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(theirs, "HEADER", Path("nowhere"))
    assert bench_ns3.main([]) == 0
    assert capsys.readouterr().err.startswith("skipped: no ")


@pytest.mark.slow
@pytest.mark.usefixtures("program")
def test_the_benchmark_prints_both_side_by_side(capsys: pytest.CaptureFixture[str]) -> None:
    assert bench_ns3.main(["--seeds", "2", "--only", "errors"]) == 0
    _, frames, offered, delay = capsys.readouterr().out.splitlines()
    assert frames.startswith("errors")
    assert all(0.9 < float(line.split()[-2]) < 1.1 for line in (frames, offered, delay))
