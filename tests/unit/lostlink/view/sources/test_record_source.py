"""A record in the view: by time, by steps, to any instant; the picture is that of a run watched up to there."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from bridge.bus.messages import AgentStatus, Header
from bridge.record import names
from bridge.record.logged import LoggedValue
from bridge.record.tables.states import STATES
from lostlink.replay.player import Player
from lostlink.view.picture.fleet_view import FleetView, view_of
from lostlink.view.sources.record import RecordSource
from tests.unit.lostlink.replay.flown import TICK_NS, Said, flown, scenario_of

SCENARIO = scenario_of("moon2020", ("0", "gcs", "1"))
TICKS = 200


def log(tick: int) -> list[Said]:
    """A number at each tick, an estimate and a word each second."""
    said: list[Said] = [("0", LoggedValue("gap_m", float(tick)))]
    if tick % 20 == 0:
        place = {"north_m": float(tick), "east_m": 0.0, "covariance_m2": [float(tick), 0.0, 1.0]}
        said += [("1", LoggedValue("estimate", place)), ("1", AgentStatus(Header.at(0, "1"), f"leg {tick}"))]
    return said


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return flown(tmp_path_factory.mktemp("runs") / "made", SCENARIO, ticks=TICKS, log=log)


class Watched:
    """A record that is watched, with a clock of its own that a look takes no time on."""

    def __init__(self, run: Path) -> None:
        self.now_s = 100.0
        self.view: FleetView = view_of(SCENARIO)
        self.source = RecordSource(Player.open(run), self.view, lambda: self.now_s)

    def wait(self, seconds: float) -> None:
        """Let wall time go by."""
        for _ in range(round(seconds / 0.05)):
            self.now_s += 0.05
            self.source.play()

    @property
    def sim_time_s(self) -> float:
        return self.view.sim_time_ns / 1e9


def picture(view: FleetView) -> dict[str, object]:
    bins, (time_s, shares) = view.links["main"].by_distance(), view.losses["main"].over_time()
    return {
        "time": view.sim_time_ns,
        "places": view.position_ned_m.tolist(),
        "sent": np.nan_to_num(view.links["main"].latest("sent")).tolist(),
        "bins": (bins.distance_m.tolist(), bins.sent.tolist(), bins.delivered.tolist()),
        "losses": (time_s.tolist(), {cause: share.tolist() for cause, share in shares.items()}),
        "fates": dict(view.losses["main"].total),
        "trail": [points.tolist() for points in view.trail],
        "logged": view.logged.latest,
        "gap_m": [values.tolist() for values in view.logged.series["0"]["gap_m"].points()],
        "shapes": {key: shape for key, (_, shape) in view.logged.shapes.items()},
        "said": [(line.node, line.text) for line in view.lines],
    }


def test_a_record_goes_on_with_wall_time_at_its_speed(run: Path) -> None:
    watched = Watched(run)
    watched.wait(2.0)
    assert watched.sim_time_s == pytest.approx(2.0, abs=0.11)
    watched.source.speed(2.0)
    watched.wait(2.0)
    assert watched.sim_time_s == pytest.approx(6.0, abs=0.21)
    watched.source.pause()
    watched.wait(3.0)
    assert watched.sim_time_s == pytest.approx(6.0, abs=0.21)
    assert watched.view.clock.paused
    watched.source.resume()
    watched.wait(1.0)
    assert watched.sim_time_s == pytest.approx(8.0, abs=0.21)


def test_a_step_is_a_tick(run: Path) -> None:
    watched = Watched(run)
    watched.wait(1.0)
    watched.source.pause()
    before_ns = watched.view.sim_time_ns
    watched.source.step()
    assert watched.view.sim_time_ns == before_ns + 50_000_000


@pytest.mark.parametrize("is_sought", [False, True])
def test_what_is_said_is_said_at_its_tick(run: Path, is_sought: bool) -> None:
    watched = Watched(run)
    if is_sought:
        watched.source.seek(3.0)
    watched.wait(3.2)
    told = {line.text: line.sim_time_ns for line in watched.view.lines if line.text.startswith("leg")}
    assert told["leg 40"] == 40 * TICK_NS
    assert told == {f"leg {tick}": tick * TICK_NS for tick in range(0, 20 * len(told), 20)}


def watched_at(run: Path, speed: float) -> Watched:
    """A record that was played to its end."""
    watched = Watched(run)
    watched.source.speed(speed)
    watched.wait(0.1 + TICKS * 0.05 / speed)
    return watched


def sought(run: Path, *way: float) -> Watched:
    """A record that was brought from one instant to the next."""
    watched = Watched(run)
    watched.source.pause()
    for place in way:
        watched.source.seek(place)
        watched.source.play()
    return watched


@pytest.mark.parametrize(
    "seen",
    [
        lambda run: watched_at(run, 1.0),
        lambda run: watched_at(run, 10.0),
        lambda run: watched_at(run, math.inf),
        lambda run: sought(run, 9.0),
        lambda run: sought(run, 9.0, 0.5, 2.0),
    ],
)
def test_a_mode_is_told_when_it_changes(run: Path, seen: Callable[[Path], Watched]) -> None:
    told = [
        (line.sim_time_ns, line.node, line.text)
        for line in seen(run).view.lines
        if line.text.startswith("mode")
    ]
    assert told == [(1_000_000_000, node, "mode RTL") for node in ("0", "1")]


@pytest.mark.parametrize("way", [(7.0,), (2.0, 7.0), (9.0, 7.0), (9.5, 1.0, 7.0)])
def test_to_go_to_an_instant_is_to_have_watched_up_to_there(run: Path, way: tuple[float, ...]) -> None:
    straight = Watched(run)
    straight.source.pause()
    while straight.view.sim_time_ns < 7_000_000_000:
        straight.source.step()
    jumped = Watched(run)
    jumped.source.pause()
    for place in way:
        jumped.source.seek(place)
        jumped.source.play()
    assert jumped.view.clock.paused
    assert picture(jumped.view) == picture(straight.view)


def test_it_stands_at_its_end_and_begins_anew_when_it_is_to_go_on(run: Path) -> None:
    watched = Watched(run)
    watched.source.seek(1e9)
    watched.source.play()
    watched.wait(0.2)
    assert watched.sim_time_s == pytest.approx((TICKS - 1) * 0.05)
    assert watched.view.clock.paused
    watched.source.resume()
    watched.source.play()
    watched.wait(0.5)
    assert watched.sim_time_s == pytest.approx(0.5, abs=0.11)


def test_as_fast_as_possible_comes_to_the_end(run: Path) -> None:
    watched = Watched(run)
    watched.source.speed(float("inf"))
    watched.wait(0.1)
    assert watched.sim_time_s == pytest.approx((TICKS - 1) * 0.05)


def test_what_agents_logged_and_said_is_shown(run: Path) -> None:
    watched = Watched(run)
    watched.source.seek(5.02)
    watched.source.play()
    logged = watched.view.logged
    assert logged.latest["0"]["gap_m"].text == "101"
    time_s, gap_m = logged.series["0"]["gap_m"].points()
    assert gap_m.tolist() == list(range(102))
    assert np.allclose(time_s, 0.05 * gap_m)
    assert logged.latest["1"]["estimate"].sim_time_ns == 5_000_000_000
    assert str(logged.latest["1"]["estimate"].shape) == "ellipse, 95 %: 49.0 x 4.9 m"  # 2 sqrt(5.9915) 10 m
    assert [line.text for line in watched.view.lines if line.node == "1"][-1] == "leg 100"


def test_a_record_whose_logs_are_damaged_is_played_all_the_same(tmp_path: Path) -> None:
    run = flown(tmp_path / "made", SCENARIO, ticks=40, log=log)
    names.logged("0").path(run).write_bytes(b"not a stream of ours")
    watched = Watched(run)
    watched.wait(1.0)
    assert watched.sim_time_s > 0.5
    told = [line.text for line in watched.view.lines if "what agents logged cannot be read" in line.text]
    assert len(told) == 1


def test_states_are_shown_of_any_instant_and_damaged_ones_are_told(tmp_path: Path) -> None:
    run = flown(tmp_path / "made", SCENARIO, ticks=40)
    watched = Watched(run)
    for goal_s, mode in ((1.5, "RTL"), (0.5, "GUIDED")):
        watched.source.seek(goal_s)
        watched.source.play()
        state = watched.view.news["1"].state
        assert state is not None
        assert (state.mode, state.header.stamp.ns) == (mode, goal_s * 1e9)
    STATES.parquet_path(run).write_bytes(b"PAR1")
    damaged = Watched(run)
    damaged.wait(1.0)
    assert damaged.sim_time_s > 0.5
    (told,) = [line.text for line in damaged.view.lines if "the states of autopilots cannot" in line.text]
    assert "states.parquet: damaged" in told


def test_losses_that_are_passed_over_do_not_flash(tmp_path: Path) -> None:
    scenario = scenario_of("{preset: perfect, base_loss: 0.5}", ("0", "gcs", "1"))
    watched = Watched(flown(tmp_path / "lossy", scenario, ticks=TICKS))
    watched.wait(2.0)
    assert watched.view.fresh_losses()
    for goal_s in (8.0, 1.0):
        watched.source.pause()
        watched.source.seek(goal_s)
        watched.source.play()
        assert watched.view.losses["main"].total["base_loss"] > 10
        assert watched.view.fresh_losses() == []
    watched.source.resume()
    watched.wait(1.0)
    assert watched.view.fresh_losses()
