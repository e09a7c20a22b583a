"""What a study of the mission measures of a run."""

from __future__ import annotations

import sys
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np

sys.path.append(str(Path(__file__).parent))

from agent import CHANNEL, mean_power_of, spread_of
from localisation.estimator import bound_m2
from localisation.model import Floats

from bridge.scenario.resolve.sensing import sensors_of
from channel.sensing.sensor import Sensor
from lostlink import Run

GRID_S = np.arange(20.0, 121.0, 2.0)
"""When errors are looked at, sim time."""
NEAR_M = 15.0
"""An error that is small enough."""


def errors(run: Run) -> dict[str, Any]:
    """Errors over time of each UA, the worst of them, the bound, and how consistent the estimates are.

    ``times_s``; ``error_<node>_m`` and ``error_m`` (mean over emitters; the worst UA's), ``bound_m`` (of readings of
    all UA, as if each was shared at once); ``nees_<node>`` (per emitter and axis: 1 if consistent); and the same at the
    end as ``final_...``, with ``final_bound_<node>_m`` (of the UA's own readings alone).
    ``found_s``: when the worst error first was less than NEAR_M, NaN if it never was.
    ``told``: share of the UA's messages that arrived, NaN if there were none.
    """
    emitters = {each.id: _place_ned_m(run, each.id) for each in run.scenario.emitters}
    found: dict[str, Any] = {"times_s": GRID_S}
    curves = {}
    nodes = [str(each.id) for each in run.scenario.ua]
    for node in nodes:
        each = [_curves(run, node, emitter, place) for emitter, place in emitters.items()]
        curves[node] = np.mean([error for error, _ in each], axis=0)
        found[f"error_{node}_m"] = curves[node]
        found[f"nees_{node}"] = np.mean([nees for _, nees in each], axis=0) / 2.0
        found[f"final_nees_{node}"] = float(found[f"nees_{node}"][-1])
        found[f"final_bound_{node}_m"] = float(_bound_m(run, emitters, GRID_S[-1:], [node])[0])
    worst = np.max(list(curves.values()), axis=0)
    bound = _bound_m(run, emitters, GRID_S, nodes)
    return found | {
        "error_m": worst,
        "bound_m": bound,
        "found_s": float(GRID_S[np.argmax(worst < NEAR_M)]) if np.any(worst < NEAR_M) else float("nan"),
        "told": _told(run),
        "final_error_m": float(worst[-1]),
        "final_bound_m": float(bound[-1]),
        **{f"final_error_{node}_m": float(curve[-1]) for node, curve in curves.items()},
    }


def _bound_m(run: Run, emitters: Mapping[str, Floats], times_s: Floats, nodes: Collection[str]) -> Floats:
    """The bound on the error of the readings of some UA at some times; mean over emitters."""
    return np.mean([_root_m(run, each, place, times_s, nodes) for each, place in emitters.items()], axis=0)


def _told(run: Run) -> float:
    """The share of the mission's own messages that arrived: data packages are not of it."""
    packets = run.packets
    fates = packets["fate"][packets["channel"] == CHANNEL]
    return float(np.mean(fates == "delivered")) if len(fates) else float("nan")


def _place_ned_m(run: Run, emitter: str) -> Floats:
    truth = run.truth[run.truth["node"] == emitter]
    axes = ["position_north_m", "position_east_m", "position_down_m"]
    return np.asarray(truth[axes].iloc[0], dtype=float)


def _curves(run: Run, node: str, emitter: str, place_ned_m: Floats) -> tuple[Floats, Floats]:
    """Error and NEES of a UA's estimates at GRID_S; NaN before the first."""
    told = run.agent_values(f"estimate.{emitter}")
    told = told[told["node"] == node]
    away = np.stack([told["north_m"], told["east_m"]], axis=-1) - place_ned_m[:2]
    terms = np.stack(told["covariance_m2"].to_list())
    covariance = terms[:, [[0, 1], [1, 2]]]
    nees = np.einsum("ni,ni->n", away, np.linalg.solve(covariance, away[..., np.newaxis])[..., 0])
    at = np.searchsorted(told["sim_time_s"].to_numpy(), GRID_S + 1e-6) - 1
    pick = np.maximum(at, 0)
    return tuple(np.where(at >= 0, each[pick], np.nan) for each in (np.hypot(*away.T), nees))


def _root_m(run: Run, emitter: str, place_ned_m: Floats, times_s: Floats, nodes: Collection[str]) -> Floats:
    """Root of the trace of the Cramer-Rao bound of the readings of some UA, at some times."""
    taken = run.agent_values("reading")
    taken = taken[(taken["emitter"] == emitter) & taken["node"].isin(nodes)]
    bounds = []
    config = run.scenario.ua[0]
    sensor = Sensor(sensors_of(run.scenario)[str(config.id)])
    spread = spread_of(sensor, config.agent.options.get("power_sigma_db", 0.0))
    tracks = [
        (group["sim_time_s"].to_numpy(), np.stack(group["place_ned_m"].to_list()))
        for _, group in taken.groupby("node")
    ]
    for time_s in times_s:
        known = [places[at_s <= time_s + 1e-6] for at_s, places in tracks]
        bounds.append(np.sqrt(np.trace(bound_m2(mean_power_of(sensor), spread, place_ned_m, known))))
    return np.array(bounds)
