"""Why the NEES is what it is: readings drawn anew along the ways that were flown.

python examples/localise/consistency.py studies/localise/runs/*/run --nodes 1 --until 100

Prints the mean NEES per axis of the readings as flown, of others at the same place and power of the emitter, and of
others with both drawn from the prior; as the estimator claims, and by the exact posterior, summed over a fine grid with
the whole covariance. The estimator's own law draws: what differs from 1 is not the channel's.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).parent))

from agent import mean_power_of, spread_of
from localisation.estimator import Area, Estimator
from localisation.model import Floats, Spread, reading
from metrics import _place_ned_m

from bridge.scenario.resolve.sensing import sensors_of
from channel.sensing.sensor import Sensor
from lostlink import Run, load_run

KINDS = ("as flown", "same emitter", "from the prior")
Powers = Mapping[str, Floats]


@dataclass(frozen=True)
class Mission:
    """What readings of a run are explained by, and where they were taken."""

    sensor: Sensor
    spread: Spread
    area: Area
    believed_dbm: float
    tracks: Mapping[str, Floats]

    def law(self, emitters: Floats, places: Floats) -> Floats:
        """Mean reading at the power that is believed."""
        return mean_power_of(self.sensor)(emitters, places) + self.believed_dbm

    def drawn(self, emitter: Floats, off_db: float, rng: np.random.Generator) -> Powers:
        """Readings of an emitter that is so much stronger than believed."""
        found = {}
        for node, places in self.tracks.items():
            root = np.linalg.cholesky(self.spread.covariance(places))
            found[node] = self.law(emitter, places) + off_db + root @ rng.standard_normal(len(places))
        return found

    def claimed(self, powers: Powers) -> tuple[Floats, Floats]:
        """Place and covariance by the mission's estimator."""
        estimator = Estimator(self.area, self.law, self.spread)
        for node, places in self.tracks.items():
            for k, (place, power_dbm) in enumerate(zip(places.tolist(), powers[node].tolist(), strict=True)):
                estimator.add(node, reading(k, 0, k, tuple(place), power_dbm))
        found = estimator.estimate()
        return found.place_m, found.covariance_m2

    def exact(self, powers: Powers) -> tuple[Floats, Floats]:
        """Mean and covariance of the posterior over the area, and where it is narrow over a finer grid about it."""
        mean, covariance = self._summed(self.area.grid(), powers)
        sigma_m = float(np.sqrt(np.linalg.eigvalsh(covariance)[-1]))
        if sigma_m > 2.0 * self.area.cell_m:
            return mean, covariance
        low, high = mean - 5.0 * sigma_m, mean + 5.0 * sigma_m
        near = Area((low[0], high[0]), (low[1], high[1]), self.area.height_m, sigma_m / 5.0)
        return self._summed(near.grid(), powers)

    def _summed(self, grid: Floats, powers: Powers) -> tuple[Floats, Floats]:
        squares, cross, ones = np.zeros(len(grid)), np.zeros(len(grid)), self.spread.power_precision
        for node, places in self.tracks.items():
            plain = powers[node][:, np.newaxis] - self.law(grid, places[:, np.newaxis, :])
            root = np.linalg.cholesky(self.spread.covariance(places))
            white = np.linalg.solve(root, np.column_stack([np.ones(len(places)), plain]))
            squares = squares + np.sum(white[:, 1:] ** 2, axis=0)
            cross, ones = cross + white[:, 0] @ white[:, 1:], ones + white[:, 0] @ white[:, 0]
        likely = -0.5 * (squares - cross**2 / ones)
        weights = np.exp(likely - np.max(likely))
        weights /= np.sum(weights)
        mean = weights @ grid[:, :2]
        away = grid[:, :2] - mean
        return mean, (weights[:, np.newaxis] * away).T @ away


def nees(found: tuple[Floats, Floats], emitter_ned_m: Floats) -> float:
    """Squared error over the covariance, per axis."""
    away = found[0] - emitter_ned_m[:2]
    return float(away @ np.linalg.solve(found[1], away)) / 2.0


def of_run(run: Run, nodes: list[str], until_s: float, redraws: int) -> dict[str, list[tuple[float, float]]]:
    """NEES as claimed and exact, by how the readings came about; of the first emitter."""
    emitter = run.scenario.emitters[0]
    options, place = run.scenario.ua[0].agent.options, _place_ned_m(run, emitter.id)
    sensor = Sensor(next(iter(sensors_of(run.scenario).values())))
    taken = run.agent_values("reading")
    taken = taken[(taken["sim_time_s"] <= until_s) & taken["node"].isin(nodes)].groupby("node")
    sides = (options["area"][axis] for axis in ("north_m", "east_m"))
    mission = Mission(
        sensor,
        spread_of(sensor, options["power_sigma_db"]),
        Area(*((low, high) for low, high in sides)),
        options["emitters"][emitter.id],
        {node: np.stack(rows["place_ned_m"].to_list()) for node, rows in taken},
    )
    flown = {node: rows["power_dbm"].to_numpy() for node, rows in taken}
    rng = np.random.default_rng([run.scenario.seed, redraws])
    found: dict[str, list[tuple[float, float]]] = {kind: [] for kind in KINDS}
    for kind, count in zip(KINDS, (1, redraws, redraws), strict=True):
        for _ in range(count):
            at, off_db = place, emitter.power_dbm - mission.believed_dbm
            if kind == "from the prior":
                low, high = np.transpose([mission.area.north_m, mission.area.east_m])
                at = np.append(rng.uniform(low, high), -mission.area.height_m)
                off_db = rng.normal(0.0, mission.spread.power_db)
            powers = flown if kind == "as flown" else mission.drawn(at, off_db, rng)
            found[kind].append((nees(mission.claimed(powers), at), nees(mission.exact(powers), at)))
    return found


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("runs", nargs="+", type=Path)
    parser.add_argument("--nodes", nargs="+", default=["0", "1"], help="whose readings")
    parser.add_argument("--until", type=float, default=120.0, help="sim time, s")
    parser.add_argument("--redraws", type=int, default=4, help="of each run")
    options = parser.parse_args()
    every = [of_run(load_run(run), options.nodes, options.until, options.redraws) for run in options.runs]
    for kind in KINDS:
        rows = np.array([row for each in every for row in each[kind]])
        claimed, exact = np.mean(rows, axis=0)
        error, _ = np.std(rows, axis=0) / np.sqrt(len(rows))
        print(
            f"{kind:<16}{len(rows):>5}   NEES as claimed {claimed:.2f} (sigma {error:.2f}), exact {exact:.2f}"
        )


if __name__ == "__main__":
    main()
