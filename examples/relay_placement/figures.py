"""What a study of the mission measures of a run, and its figure: what gets through, with the relay and without it."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure

sys.path.append(str(Path(__file__).parent))

from placement import Floats, Links, direct, grid, links_of, relayed

from channel import Radio
from channel.presets import radio_from_mapping
from lostlink import Run

if TYPE_CHECKING:
    import pandas as pd

PAYLOAD_BYTES = 24
"""Of the mission's packets, see agent.py."""
WINDOW_S = 4.0
"""Shares are those of packets that were sent within so long, about each instant."""
LATE_S = 15.0
"""The last part of the flight, in which the UA is farthest."""


def measure(run: Run) -> dict[str, Any]:
    """What got through over time, and what the model says of the true places.

    ``times_s`` (each second); ``share``: of commands that arrived, times that of reports; ``model``: the same by
    the model at the relay's true place, ``best`` at the best of the candidate places, ``half_way`` between the ends,
    ``direct`` without a relay; ``up``, ``down``: shares of all packets; ``late``: ``share`` over the last 15 s, and
    ``late_<which>`` the mean of the model's there; ``<who>_north_m``, ``<who>_east_m`` of ``mover``, ``relay`` and
    ``best``.
    """
    ground, mover, relay = _names(run)
    times_s = np.arange(1.0, np.floor(run.summary["sim_duration_s"]))
    places = {who: _track_ned_m(run, node, times_s) for who, node in (("mover", mover), ("relay", relay))}
    arrived = [_arrived(run, sender, receiver) for sender, receiver in ((ground, mover), (mover, ground))]
    late = (times_s[-1] - LATE_S, times_s[-1])
    found = {
        "times_s": times_s,
        "share": _over_time(arrived, times_s),
        "up": float(np.mean(arrived[0][1])),
        "down": float(np.mean(arrived[1][1])),
        "late": float(np.prod([_share(each, *late) for each in arrived])),
    }
    model = _model(run, places["mover"], places["relay"])
    places["best"] = model.pop("best_ned_m")
    found |= model
    found |= {f"late_{which}": float(np.mean(chance[times_s >= late[0]])) for which, chance in model.items()}
    for who, track in places.items():
        found |= {f"{who}_north_m": track[:, 0], f"{who}_east_m": track[:, 1]}
    return found


def _names(run: Run) -> tuple[str, str, str]:
    """Ids of the ground station, the UA that flies away, and the relay."""
    (relay,) = (each for each in run.scenario.ua if "radios" in each.agent.options)
    return relay.agent.options["ground"], relay.agent.options["ua"], str(relay.id)


def _relay_options(run: Run) -> dict[str, Any]:
    _, _, relay = _names(run)
    return next(dict(each.agent.options) for each in run.scenario.ua if str(each.id) == relay)


def _track_ned_m(run: Run, node: str, times_s: Floats) -> Floats:
    """True places, shape (n, 3)."""
    truth = run.truth[run.truth["node"] == node]
    axes = [truth[f"position_{axis}_m"] for axis in ("north", "east", "down")]
    return np.stack([np.interp(times_s, truth["sim_time_s"], axis) for axis in axes], axis=-1)


def _arrived(run: Run, sender: str, receiver: str) -> tuple[Floats, Floats]:
    """Of each packet that an end sent: when, s, and whether it came to the other, by whatever way."""
    sent = run.agent_values("sent")
    sent = sent[sent["node"] == sender]
    came = run.agent_values("arrived")
    numbers = came[came["node"] == receiver]["number"]
    return sent["sim_time_s"].to_numpy(), sent["value"].isin(numbers).to_numpy(dtype=float)


def _share(packets: tuple[Floats, Floats], begin_s: float, end_s: float) -> float:
    sent_s, came = packets
    return float(np.mean(came[(sent_s >= begin_s) & (sent_s < end_s)]))


def _over_time(arrived: list[tuple[Floats, Floats]], times_s: Floats) -> Floats:
    half = WINDOW_S / 2.0
    return np.array(
        [np.prod([_share(each, at - half, at + half) for each in arrived]) for at in times_s.tolist()]
    )


def _links(run: Run) -> tuple[Links, Floats]:
    """The model with the radios that the run had, and where the ground station is."""
    ground, mover, _ = _names(run)
    radios = {str(each.id): each.radio or run.scenario.radio for each in run.scenario.nodes}
    place = next(each.place for each in run.scenario.nodes if str(each.id) == ground)
    made = (Radio(radio_from_mapping(dict(radios[each]))) for each in (ground, mover))
    return links_of(*made, PAYLOAD_BYTES), np.array([place.north_m, place.east_m, -place.height_m])


def _model(run: Run, mover: Floats, relay: Floats) -> dict[str, Floats]:
    links, ground = _links(run)
    options = _relay_options(run)
    candidates = grid(**options["area"], height_m=options["altitude_m"])
    chances = relayed(links, ground, mover[:, np.newaxis], candidates).both
    half_way = (ground + mover) / 2.0
    half_way[:, 2] = -options["altitude_m"]
    return {
        "model": relayed(links, ground, mover, relay).both,
        "half_way": relayed(links, ground, mover, half_way).both,
        "direct": direct(links, ground, mover).both,
        "best": np.max(chances, axis=1),
        "best_ned_m": candidates[np.argmax(chances, axis=1)],
    }


def draw(table: pd.DataFrame, directory: Path) -> None:
    """The first run's map, and over time the shares of all runs with what the model says."""
    flown = table[table["failure"] == ""]
    figure = Figure(figsize=(11, 4.6), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1, 1.5))
    cases = dict(iter(flown.groupby("case", sort=False)))
    first = cases["relay"].iloc[0]
    _map(left, first)
    for colour, (case, rows) in zip(("C0", "C3"), cases.items(), strict=True):
        length = min(map(len, rows["times_s"]))
        times_s = first["times_s"][:length]
        shares = np.stack([share[:length] for share in rows["share"]])
        label = f"{'with' if case == 'relay' else 'without'} the relay, {len(rows)} seeds"
        right.plot(times_s, shares.T, color=colour, linewidth=0.6, alpha=0.35)
        right.plot(times_s, shares.mean(axis=0), color=colour, linewidth=2, label=label)
    right.plot(first["times_s"], first["best"], "k--", linewidth=1, label="model: relay at the best place")
    right.plot(first["times_s"], first["model"], "k:", linewidth=1.4, label="model: relay where it was")
    right.plot(first["times_s"], first["half_way"], "--", color="grey", linewidth=1, label="model: half-way")
    right.plot(first["times_s"], first["direct"], "k-.", linewidth=1, label="model: no relay")
    right.set(xlabel="sim time, s", ylabel="command and report both get through, share", ylim=(-0.03, 1.03))
    right.legend(fontsize=8, loc="lower left")
    figure.savefig(directory / "relay-placement.png", dpi=110)


def _map(axes: Any, row: pd.Series) -> None:
    axes.plot(0, 0, "k^", label="ground station")
    for who, colour, label in (("mover", "C1", "UA"), ("relay", "C0", "relay")):
        east, north = row[f"{who}_east_m"], row[f"{who}_north_m"]
        axes.plot(east, north, color=colour, label=label)
        axes.plot(east[-1], north[-1], "o", color=colour)
    axes.plot(row["best_east_m"], row["best_north_m"], "k+", markersize=5, label="best place, each second")
    axes.set(xlabel="east, m", ylabel="north, m", aspect="equal")
    axes.legend(fontsize=8, loc="center right")
