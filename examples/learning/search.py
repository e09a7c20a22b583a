"""A cross-entropy search for the options of an agent: a study per generation, all with the same seeds.

python examples/learning/search.py
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pandas as pd

from lostlink import LocalLanes, fly_study

HERE = Path(__file__).parent
AGENT = "nodes.1.agent.options"
LEAST = {"share": 0.0, "gain_per_s": 0.05, "height_m": 5.0}
MOST = {"share": 1.0, "gain_per_s": 1.0, "height_m": 40.0}
Vectors = npt.NDArray[np.float64]


def flown(candidates: Vectors, seeds: int, out: Path, duration_s: float, lanes: LocalLanes) -> pd.Series:
    """The mean score of each candidate over the seeds, of a run that failed 0; none is flown a second time."""
    cases = {
        str(number): {f"{AGENT}.{name}": value for name, value in zip(LEAST, each, strict=True)}
        for number, each in enumerate(candidates)
    }
    study = {
        "schema": 1,
        "name": "search",
        "scenario": HERE / "follow.yaml",
        "seeds": {"first": 1, "count": seeds},
        "set": {"duration_s": duration_s},
        "cases": cases,
        "metrics": f"{HERE / 'follow.py'}:score",
        "keep": "failed",
    }
    table = fly_study(study, directory=out, lanes=lanes).table
    return table.score.fillna(0.0).groupby(table.case.astype(int)).mean()


def search(generations: int, count: int, seeds: int, out: Path, duration_s: float = 60.0) -> Vectors:
    """The best candidate of the last generation."""
    rng = np.random.default_rng(1)
    least, most = (np.array(list(bounds.values())) for bounds in (LEAST, MOST))
    mean, sigma = (least + most) / 2, (most - least) / 4
    best = mean
    with LocalLanes() as lanes:  # their processes stay from study to study
        for generation in range(generations):
            drawn = np.clip(rng.normal(mean, sigma, (count - 1, len(mean))), least, most)
            candidates = np.vstack([best, drawn])  # the best so far costs nothing: its runs are done
            scores = flown(candidates, seeds, out, duration_s, lanes)
            elite = candidates[scores.nlargest(max(2, count // 4)).index]
            best, mean, sigma = elite[0], elite.mean(axis=0), elite.std(axis=0) + 0.02 * (most - least)
            print(
                generation,
                f"{scores.max():.3f}",
                dict(zip(LEAST, best.round(3).tolist(), strict=True)),
                flush=True,
            )
    return best


def main() -> None:
    """Search, as the command line says."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--generations", type=int, default=5)
    parser.add_argument("--count", type=int, default=12)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--out", type=Path, default=Path("studies"))
    arguments = parser.parse_args()
    search(arguments.generations, arguments.count, arguments.seeds, arguments.out)


if __name__ == "__main__":
    main()
