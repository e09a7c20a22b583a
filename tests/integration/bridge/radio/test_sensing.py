"""RF sensors in real runs: the record against the channel's law, agents against the record, and who else is there.

The oracles are closed forms written here: free space to 1 m and a power of the distance beyond, computed from the true
places in `truth.parquet`; the normal and the exponential law; and an exact Gaussian process along the very track.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray
from scipy import stats

from bridge.agents import connect_ua
from bridge.agents.measurements import Measurement, measurements_by_node
from bridge.record.tables.measurements import MEASUREMENTS
from bridge.record.tables.reader import read_columns
from bridge.record.tables.schema import Table
from bridge.record.tables.truth import TRUTH
from lostlink.reading.run import load_run
from lostlink.replay.player import Player
from tests.integration.bridge.conftest import Run, StartRun

Floats = NDArray[np.float64]
CARRIER_HZ = 433.92e6
SIGMA_DB, DECORRELATION_M, EXPONENT = 4.0, 10.0, 2.2
FLOOR_DBM = 10.0 * np.log10(1.380649e-23 * 290.0 * 200e3 * 1e3) + 8.0
PLAIN = {"preset": "rf-sensor", "earth_radius_factor": None, "fading": {"model": "none"}}
SHADOWED = PLAIN | {
    "shadowing": {"model": "gudmundson", "sigma_db": SIGMA_DB, "decorrelation_m": DECORRELATION_M}
}
FADED = PLAIN | {"shadowing": {"model": "none"}, "fading": {"model": "rayleigh"}}
SURVEYOR = """\
from bridge.agents import Agent

class Surveyor(Agent):
    '''Flies lanes that are farther apart than shadowing reaches.'''

    async def fly(self):
        await self.take_off(30.0)
        await self.ua.change_speed(15.0)
        for north_m, east_m in self.options["lanes"]:
            await self.ua.goto_ned(north_m, east_m, -30.0, frame="origin")
"""
KEEPER = """\
from bridge.agents import Agent

class Keeper(Agent):
    def on_measurement(self, measurement):
        self.record(
            "seen", number=measurement.number, taken_ns=measurement.sim_time_ns, power_dbm=measurement.power_dbm,
            frequency_hz=measurement.frequency_hz, emitter=measurement.emitter,
            state_ns=measurement.state and measurement.state.header.stamp.ns, now_ns=self.ua.sim_time_ns,
        )

    def on_packet(self, sender, channel, payload, reception):
        super().on_packet(sender, channel, payload, reception)
        powers = list(self.latest[sender].received_power_dbm) if sender in self.latest else []
        if powers:
            self.record("told", sender=sender, powers=powers)

    async def fly(self):
        await self.sleep(4.0)
"""


STILL_AGENT: dict[str, object] = {"type": "still"}


def emitters(count: int, **changes: object) -> list[dict[str, object]]:
    """Emitters on a wide ring."""
    angles = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    return [
        {
            "id": f"e{i}",
            "kind": "emitter",
            "place": {
                "north_m": float(round(150.0 + 500.0 * np.cos(angle), 3)),
                "east_m": float(round(180.0 + 500.0 * np.sin(angle), 3)),
            },
            "frequency_hz": CARRIER_HZ,
            "power_dbm": 20.0,
            **changes,
        }
        for i, angle in enumerate(angles)
    ]


def scenario(nodes: Sequence[dict[str, object]], **more: object) -> str:
    """The text of a scenario, for `start_run`."""
    tree = {
        "schema": 1,
        "name": "sensing",
        "seed": 3,
        "speed": "SPEED",
        "duration_s": "DURATION",
        "origin": {"lat_deg": 40.1331, "lon_deg": -105.2404, "alt_amsl_m": 1690.0},
        "radio": "perfect",
        "ports": {"zenoh": 0, "first_slot": "SLOT"},
        "nodes": list(nodes),
        **more,
    }
    text = yaml.safe_dump(tree, sort_keys=False).replace("{", "{{").replace("}", "}}")
    for name, place in (("SPEED", "{speed}"), ("DURATION", "{duration_s}"), ("SLOT", "{slot}")):
        text = text.replace(name, place)
    return text


def columns(run: Run, table: Table, **wanted: str) -> dict[str, NDArray[np.generic]]:
    """Columns of those rows of a table that have the wanted names."""
    whole = read_columns(run.directory, table)
    rows = np.ones(len(whole["sim_time_ns"]), dtype=bool)
    for name, value in wanted.items():
        rows &= whole[name] == value
    return {name: column[rows] for name, column in whole.items()}


def track(run: Run, node: str) -> Floats:
    """True places at the ticks, shape (ticks, 3)."""
    truth = columns(run, TRUTH, node=node)
    return np.stack([truth[f"position_{axis}_m"] for axis in ("north", "east", "down")], axis=-1)


def mean_dbm(distance_m: Floats) -> Floats:
    """Of 20 dBm."""
    return (
        20.0
        - 20.0 * np.log10(4.0 * np.pi * CARRIER_HZ / 299_792_458.0)
        - 10.0 * EXPONENT * np.log10(distance_m)
    )


def residuals_db(run: Run, node: str, places: Floats, sources: Sequence[dict[str, object]]) -> Floats:
    """Readings less the closed-form mean at the true places, shape (ticks, emitters)."""
    found = []
    for each in sources:
        rows = columns(run, MEASUREMENTS, node=node, emitter=str(each["id"]))
        assert rows["number"].tolist() == list(range(len(places)))
        place = each["place"]
        assert isinstance(place, dict)
        way = places - np.array([place["north_m"], place["east_m"], -2.0])
        distance_m = np.sqrt(np.sum(way * way, axis=-1))
        assert rows["distance_m"] == pytest.approx(distance_m, abs=6e-4)
        found.append(rows["reading_dbm"] - mean_dbm(distance_m))
    return np.stack(found, axis=-1)


def apart(places: Floats, least_m: float) -> list[int]:
    """Rows of places no two of which are nearer to each other than that."""
    chosen: list[int] = []
    for row, place in enumerate(places):
        if all(np.linalg.norm(place - places[other]) >= least_m for other in chosen):
            chosen.append(row)
    return chosen


def decorrelation_m(z: Floats, distance_m: Sequence[float]) -> float:
    """The distance at which exp(-d / d_corr) fits the products of neighbours best, z of shape (rows, links)."""
    logs = [-np.log(np.mean(z[lag:] * z[:-lag]) / np.mean(z * z)) for lag in LAGS]
    return float(np.dot(distance_m, distance_m) / np.dot(distance_m, logs))


LAGS = (1, 2, 3)
"""Of half a decorrelation distance each."""
LANES = [(300.0 - 280.0 * (lane % 2), 60.0 * (lane + more)) for lane in range(6) for more in (0, 1)]
"""Corners of lanes that are farther apart than shadowing reaches: north and east, m."""
FAINT_DB = float(FLOOR_DBM - mean_dbm(np.array(500.0)))
"""Brings the power at half a kilometre down to the noise floor."""
SHADOWED_SENSOR = {"radio": SHADOWED, "rate_hz": 20, "averages": 10**8, "step_db": 0.001}
FADED_SENSOR = {"radio": FADED | {"offset_db": FAINT_DB}, "rate_hz": 20, "averages": 1, "step_db": 0.5}


LEGS, LEG_M, SPEED_MPS = 40, 100.0, 100.0


def zigzag() -> list[dict[str, float]]:
    """Legs in directions that are spread evenly over the sphere, one after the other in random order, as a track.

    All waves of a run's one field then count alike, as they do over the seeds: along a straight way the correlation is
    that of the 48 waves, which is farther from the law (docs/reference/channel-models.md).
    """
    n = np.arange(LEGS)
    up, azimuth = 1.0 - 2.0 * (n + 0.5) / LEGS, n * np.pi * (3.0 - np.sqrt(5.0))
    across = np.sqrt(1.0 - up * up)
    ways = LEG_M * np.stack((across * np.cos(azimuth), across * np.sin(azimuth), up), axis=-1)
    ways = ways[np.random.default_rng(0).permutation(LEGS)]
    corners = np.concatenate((np.zeros((1, 3)), ways.cumsum(axis=0)))
    return [
        {"sim_time_s": k * LEG_M / SPEED_MPS, "north_m": north, "east_m": east, "height_m": 1000.0 + up}
        for k, (north, east, up) in enumerate(corners.tolist())
    ]


@pytest.mark.slow
def test_powers_in_the_record_of_a_run_follow_the_channels_law(start_run: StartRun) -> None:
    """A node on a track measures shadowing, a UA that stands fading and noise."""
    sources = emitters(16)
    mover = {"id": "mover", "kind": "ground", "track": zigzag(), "agent": STILL_AGENT}
    nodes = [
        {"id": 1, "home": {"north_m": 150}, "sensor": FADED_SENSOR, "agent": STILL_AGENT},
        mover | {"sensor": SHADOWED_SENSOR},
        *sources,
    ]
    run = start_run(scenario=scenario(nodes), duration_s=LEGS * LEG_M / SPEED_MPS)
    assert run.finish(90.0) == 0, run.output.decode()
    low_m, found_m, high_m = judge_shadowing(run, "mover", sources)
    assert low_m < found_m < high_m
    judge_fading(run, "1", sources)


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.timeout(700)
def test_powers_that_two_flying_ua_measure_follow_the_channels_law(
    start_run: StartRun, tmp_path: Path
) -> None:
    (tmp_path / "surveyor.py").write_text(SURVEYOR)
    sources = emitters(16)
    agent = {"type": "own", "class": f"{tmp_path}/surveyor.py:Surveyor", "options": {"lanes": LANES}}
    nodes = [
        {"id": 0, "sensor": SHADOWED_SENSOR, "agent": agent},
        {"id": 1, "home": {"north_m": 150}, "sensor": FADED_SENSOR, "agent": agent},
        *sources,
    ]
    run = start_run(scenario=scenario(nodes), duration_s=400.0)
    assert run.finish(600.0) == 0, run.output.decode()
    assert run.summary["ending"] == "done"
    low_m, found_m, high_m = judge_shadowing(run, "0", sources)
    lanes = 1.35  # the field of one run along straight lanes: its correlation is within 0.1 of 0.37 at this distance
    assert low_m / lanes < found_m < high_m * lanes
    judge_fading(run, "1", sources)


def judge_shadowing(run: Run, node: str, sources: Sequence[dict[str, object]]) -> tuple[float, float, float]:
    """N(0, sigma^2) at places far from each other; the decorrelation distance of near ones within its 99.9 % interval.

    The interval is that of an exact Gaussian process with the law's covariance at these very places.
    """
    places = track(run, node)
    loss_db = residuals_db(run, node, places, sources)
    far = apart(places, 5.0 * DECORRELATION_M)
    assert len(far) > 25
    alone = loss_db[far].ravel() / SIGMA_DB
    assert stats.kstest(alone, stats.norm.cdf).pvalue > 1e-3
    assert abs(float(np.mean(alone * alone)) - 1.0) < 3.29 * np.sqrt(2.0 / alone.size)
    steps_m = np.concatenate(([0.0], np.linalg.norm(np.diff(places, axis=0), axis=1))).cumsum()
    rows = np.unique(np.searchsorted(steps_m, np.arange(0.0, steps_m[-1], 0.5 * DECORRELATION_M)))
    places, z = places[rows], loss_db[rows] / SIGMA_DB
    distance_m = [float(np.mean(np.linalg.norm(places[lag:] - places[:-lag], axis=1))) for lag in LAGS]
    between_m = np.linalg.norm(places[:, np.newaxis] - places[np.newaxis], axis=-1)
    root = np.linalg.cholesky(np.exp(-between_m / DECORRELATION_M) + 1e-9 * np.eye(len(places)))
    random = np.random.default_rng(1)
    law_m = [decorrelation_m(root @ random.standard_normal(z.shape), distance_m) for _ in range(200)]
    spread_m = 3.29 * float(np.std(law_m))
    assert spread_m < 0.2 * DECORRELATION_M
    middle_m = float(np.mean(law_m))
    return middle_m - spread_m, decorrelation_m(z, distance_m), middle_m + spread_m


def judge_fading(run: Run, node: str, sources: Sequence[dict[str, object]]) -> None:
    """One sample of a Rayleigh-faded signal and noise is exponential, each time anew; and what is told of it."""
    residual_db = residuals_db(run, node, track(run, node), sources)
    for column, each in enumerate(sources):
        rows = columns(run, MEASUREMENTS, node=node, emitter=str(each["id"]))
        reading_dbm = rows["reading_dbm"]
        mean = reading_dbm - residual_db[:, column] + FAINT_DB
        share = 10.0 ** (reading_dbm / 10.0) / (10.0 ** (mean / 10.0) + 10.0 ** (FLOOR_DBM / 10.0))
        assert stats.kstest(share, stats.expon.cdf).pvalue > 1e-3 / len(sources)
        told = reading_dbm >= round(FLOOR_DBM + 3.0, 3)
        assert 0.15 < told.mean() < 0.75
        assert (rows["outcome"] == np.where(told, "measured", "below_threshold")).all()
        assert (rows["power_dbm"][told] == np.rint(reading_dbm[told] * 2.0) / 2.0).all()
        assert np.isnan(rows["power_dbm"][~told]).all()


def van(agent: dict[str, object] = STILL_AGENT) -> dict[str, object]:
    """A node on the ground that moves."""
    points = [{"sim_time_s": 0.0, "north_m": 0.0}, {"sim_time_s": 4.0, "north_m": 60.0, "height_m": 5.0}]
    return {
        "id": "van",
        "kind": "ground",
        "track": points,
        "sensor": {"radio": "rf-sensor", "rate_hz": 5},
        "agent": agent,
    }


def small_and_large(start_run: StartRun, tmp_path: Path) -> tuple[Run, Run]:
    """Runs of a UA, a van and a mover: alone, and among others."""
    (tmp_path / "keeper.py").write_text(KEEPER)
    page = (Path(__file__).parents[4] / "docs" / "reference" / "sensing.md").read_text()
    (tmp_path / "seeker.py").write_text(page.split("```python\n")[1].split("```")[0])
    agent = {"type": "own", "class": f"{tmp_path}/keeper.py:Keeper"}
    mover = {
        "id": "mover",
        "kind": "emitter",
        "track": [{"sim_time_s": 0, "east_m": 80}, {"sim_time_s": 4, "east_m": 120}],
        "frequency_hz": 433.9e6,
        "power_dbm": 15.0,
        "duty": 0.7,
        "slot_s": 0.1,
    }
    base = {"id": 1, "home": {"north_m": 40}, "sensor": {"rate_hz": 10}, "agent": agent}
    other = {"id": 0, "agent": agent, "sensor": {"identifies": "none"}}
    seeker = {"type": "own", "class": f"{tmp_path}/seeker.py:Seeker", "has_task": False}
    small = start_run(scenario=scenario([base, mover, van(seeker)]), duration_s=5.0)
    assert small.finish() == 0, small.output.decode()
    large = start_run(scenario=scenario([*emitters(3), other, van(), mover, base], hosts=2), duration_s=5.0)
    assert large.finish() == 0, large.output.decode()
    return small, large


@pytest.mark.slow
def test_agents_get_what_their_sensor_tells_and_others_change_none_of_it(
    start_run: StartRun, tmp_path: Path
) -> None:
    small, large = small_and_large(start_run, tmp_path)
    for node in ("1", "van"):
        few, many = (columns(run, MEASUREMENTS, node=node, emitter="mover") for run in (small, large))
        # in text, as not a number is not equal to itself
        assert str({name: column.tolist() for name, column in few.items()}) == str(
            {name: column.tolist() for name, column in many.items()}
        )
        assert {"measured", "silent"} == set(few["outcome"].tolist())
    assert (
        columns(large, MEASUREMENTS, node="1")["number"].max()
        == columns(small, MEASUREMENTS, node="1")["number"].max()
    )

    rows = columns(small, MEASUREMENTS, node="1")
    heard = rows["outcome"] == "measured"
    seen = seen_by(small, "1", "seen")
    recorded = zip(rows["number"][heard], rows["sim_time_ns"][heard], rows["power_dbm"][heard], strict=True)
    arrived = [
        (number, tick, power)
        for number, tick, power in recorded
        if tick < max(r["taken_ns"] for r in seen) + 1
    ]
    assert [(r["number"], r["taken_ns"], r["power_dbm"]) for r in seen] == arrived
    assert len(seen) > 20
    assert {(r["emitter"], r["frequency_hz"]) for r in seen} == {("mover", 433.9e6)}
    assert all(r["now_ns"] - r["taken_ns"] == 50_000_000 for r in seen)
    fixed = [r for r in seen if r["state_ns"] is not None]  # it knows where it is
    assert len(fixed) > 5
    assert all(r["now_ns"] - r["state_ns"] == 50_000_000 for r in fixed)
    assert {(r["emitter"], r["frequency_hz"]) for r in seen_by(large, "0", "seen")} == {(None, None)}
    of_1 = [power for r in seen_by(large, "0", "told") if r["sender"] == "1" for power in r["powers"]]
    of_1_itself = [r["power_dbm"] for r in seen_by(large, "1", "seen")]
    assert len(of_1) > 5  # from its first fix on: before that it is not in `latest`
    assert any(
        of_1 == of_1_itself[first : first + len(of_1)] for first in range(len(of_1_itself) - len(of_1) + 1)
    )
    assert len(seen_by(small, "van", "power")) > 10  # the page's agent
    read = load_run(large.directory)
    assert set(read.measurements["emitter"]) == {"e0", "e1", "e2", "mover"}
    assert set(read.links["rx"]) == {"0", "van", "1"}
    moment = Player.open(large.directory).seek(2_000_000_000)
    assert moment.truth()["mover"].position_ned_m.y == pytest.approx(100.0)
    truth = columns(large, TRUTH, node="mover")
    assert truth["position_east_m"][40] == pytest.approx(100.0)


@pytest.mark.slow
def test_a_program_beside_the_run_gets_what_the_sensor_of_its_node_tells(start_run: StartRun) -> None:
    run = start_run(
        scenario=scenario([{"id": 0, "agent": STILL_AGENT}, van(), *emitters(2)]), duration_s=12.0, speed="2"
    )
    run.wait_for("sim time")

    heard: list[Measurement] = []

    async def listen() -> set[str | None]:
        async with connect_ua(run.directory, "van") as ua:
            enough = asyncio.Event()
            ua.on_measurement(lambda each: heard.append(each) or len(heard) < 20 or enough.set())
            await asyncio.wait_for(enough.wait(), 30.0)
            return {each.emitter for each in ua.measurements.latest}

    assert asyncio.run(listen()) == {"e0", "e1"}
    assert run.finish() == 0, run.output.decode()
    again: dict[int, list[Measurement]] = {}
    for moment in Player.open(run.directory).moments():
        for node, message in moment.measurements():
            assert (node, message.header.frame_id) == ("van", "van")
            (again[moment.sim_time_ns],) = measurements_by_node(message).values()
    assert [replace(each, state=None, place_ned_m=None) for each in heard] == [
        each for at_ns in sorted({each.sim_time_ns for each in heard}) for each in again[at_ns]
    ][: len(heard)]


def test_in_the_record_a_sensor_on_the_ground_is_the_base_and_one_on_a_ua_is_not(start_run: StartRun) -> None:
    """TR 36.777, RMa-AV without line of sight, by hand: the aircraft at 100 m, or a UA that counts as at 10 m."""
    law = {"model": "rma-av", "outside": "clamp", "line_of_sight": "never"}
    radio = PLAIN | {"shadowing": {"model": "none"}, "propagation": law}
    sensor = {"radio": radio, "rate_hz": 20}
    high = {
        "id": "high",
        "kind": "emitter",
        "place": {"north_m": 1000.0, "height_m": 100.0},
        "frequency_hz": CARRIER_HZ,
        "power_dbm": 20.0,
    }
    tower = {"id": "tower", "kind": "ground", "place": {"height_m": 2.0}, "agent": STILL_AGENT}
    ua = {"id": 0, "agent": STILL_AGENT, "home": {"east_m": 5.0}}
    run = start_run(
        scenario=scenario([ua | {"sensor": sensor}, tower | {"sensor": sensor}, high]), duration_s=1.0
    )
    assert run.finish() == 0, run.output.decode()
    for node, aircraft_m in (("tower", 40.0), ("0", 10.0)):
        rows = columns(run, MEASUREMENTS, node=node)
        slope = 35.0 - 5.3 * np.log10(aircraft_m)
        f_db = 20.0 * np.log10(40.0 * np.pi * CARRIER_HZ / 1e9 / 3.0)
        expected_dbm = 32.0 - slope * np.log10(rows["distance_m"]) - f_db
        assert len(expected_dbm) > 10
        assert rows["mean_power_dbm"] == pytest.approx(expected_dbm, abs=1e-3)


def seen_by(run: Run, node: str, name: str) -> list[dict[str, object]]:
    """What an agent wrote."""
    lines = (run.directory / "agents" / node / f"{name}.jsonl").read_text().splitlines()
    return [json.loads(line) for line in lines]
