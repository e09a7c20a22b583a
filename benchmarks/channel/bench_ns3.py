"""lostlink's 802.11 DCF beside ns-3's, setting by setting: `python -m benchmarks ns3`.

    python -m benchmarks.channel.bench_ns3 [--seeds 8] [--only TEXT] [--record FILE]

Needs ns-3 3.37 with its headers (Debian: apt install libns3-dev) and g++. Figures are means over seeds, with their
standard errors; z is the difference over its standard error. `--record` writes those of ns-3 as CSV.
"""

from __future__ import annotations

import argparse
import csv
import sys
import tempfile
from collections.abc import Sequence
from math import hypot, inf, sqrt
from pathlib import Path
from statistics import fmean, stdev
from typing import NamedTuple

from benchmarks.channel.ns3 import ours, theirs
from benchmarks.channel.ns3.settings import SETTINGS, Counts, Setting, figures_of

SEEDS = 8
COLUMNS = ("setting", "group", "figure", "mean", "standard_error", "seeds")


class Mean(NamedTuple):
    """Over seeds."""

    value: float
    standard_error: float


Means = dict[tuple[str, str], Mean]


def means(runs: Sequence[Counts], setting: Setting) -> Means:
    """Of each figure, by group and name."""
    by_seed = [figures_of(counts, setting) for counts in runs]
    return {
        key: Mean(fmean(values), stdev(values) / sqrt(len(values)))
        for key in by_seed[0]
        for values in [[figures[key] for figures in by_seed]]
    }


def ours_of(setting: Setting, seeds: int) -> Means:
    """By lostlink."""
    return means([ours.run(setting, seed) for seed in range(1, seeds + 1)], setting)


def print_setting(name: str, found: Means, expected: Means) -> None:
    """A line for each figure."""
    for (group, figure), ns3 in expected.items():
        here = found[group, figure]
        error = hypot(here.standard_error, ns3.standard_error)
        difference = here.value - ns3.value
        z = 0.0 if not difference else difference / error if error else inf
        ratio = here.value / ns3.value if ns3.value else inf
        label = f"{name}, {group}" if group else name
        print(f"{label:44} {figure:20} {_mean(ns3):>20} {_mean(here):>20} {ratio:7.4f} {z:+6.1f}", flush=True)


def _mean(mean: Mean) -> str:
    return f"{mean.value:.5g} ± {mean.standard_error:.2g}"


def main(argv: Sequence[str] | None = None) -> int:
    """Build ns-3's side, run both, print them side by side."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=SEEDS, help="at least 2")
    parser.add_argument("--only", default="", help="settings whose name has this in it")
    parser.add_argument("--record", type=Path, help="CSV of ns-3's figures")
    options = parser.parse_args(argv)
    lacking = theirs.missing()
    if lacking is not None:
        print(f"skipped: {lacking}", file=sys.stderr)
        return 0
    rows = []
    print(f"{'setting':44} {'figure':20} {'ns-3':>20} {'lostlink':>20} {'ratio':>7} {'z':>6}")
    with tempfile.TemporaryDirectory() as folder:
        program = theirs.build(Path(folder))
        for name, setting in SETTINGS.items():
            if options.only in name:
                expected = means(theirs.run(program, setting, options.seeds), setting)
                print_setting(name, ours_of(setting, options.seeds), expected)
                if setting.note:
                    print(f"    {setting.note}")
                rows += [(name, *key, *_rounded(mean), options.seeds) for key, mean in expected.items()]
    if options.record:
        _record(options.record, rows, options.seeds)
    return 0


def _rounded(mean: Mean) -> tuple[str, str]:
    return f"{mean.value:.6g}", f"{mean.standard_error:.3g}"


def _record(file: Path, rows: Sequence[tuple[object, ...]], seeds: int) -> None:
    with file.open("w", newline="") as out:
        out.write(
            f"# ns-3 3.37; python -m benchmarks.channel.bench_ns3 --seeds {seeds} --record {file.name}\n"
        )
        writer = csv.writer(out, lineterminator="\n")
        writer.writerows([COLUMNS, *rows])


if __name__ == "__main__":
    sys.exit(main())
