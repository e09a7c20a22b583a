"""A record that is played, moved by verbs."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from lostlink.replay.player import Player
from lostlink.replay.playing.controls import Controls
from lostlink.replay.playing.pace import Pace
from tests.unit.lostlink.replay.flown import TICK_NS, flown, scenario_of

S = 1_000_000_000


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return flown(tmp_path_factory.mktemp("runs") / "made", scenario_of("perfect", ("0", "1")), 101)


def controls(run: Path, begin_ns: int = 0, end_ns: int = 5 * S) -> Controls:
    return Controls(Player.open(run), Pace(1.0, begin_ns, 0.0), begin_ns, end_ns)


def played(moved: Controls) -> list[int]:
    found = []
    while (moment := moved.next(0.0)) is not None:
        found.append(moment.sim_time_ns)
    return found


def test_plays_the_part_that_was_asked_for(run: Path) -> None:
    assert played(controls(run)) == list(range(0, 101 * TICK_NS, TICK_NS))
    assert played(controls(run, 2 * S, 3 * S)) == list(range(2 * S, 3 * S + 1, TICK_NS))
    assert played(controls(run, 2 * S, 2 * S)) == [2 * S]


def test_rewinds_to_where_it_began(run: Path) -> None:
    moved = controls(run, 2 * S, 3 * S)
    played(moved)
    assert moved.rewind(7.0).sim_time_ns == 2 * S
    assert moved.due_s() == pytest.approx(7.05)


def test_seeks_within_what_is_played(run: Path) -> None:
    moved = controls(run, 1 * S, 4 * S)
    moment = moved.do("seek", " 3.5 ", 10.0)
    assert moment is not None
    assert moment.sim_time_ns == 3_500_000_000
    assert moved.due_s() == pytest.approx(10.05)
    first = moved.do("seek", "1", 10.0)
    assert first is not None
    assert first.sim_time_ns == 1 * S
    for wrong, why in {"4.5": "from 1 to 4", "0.9": "from 1 to 4", "nan": "a number", "": "a number"}.items():
        with pytest.raises(ValueError, match=why):
            moved.do("seek", wrong, 10.0)


def test_steps_while_paused(run: Path) -> None:
    moved = controls(run)
    moved.next(0.0)
    moment = moved.do("step", "", 0.0)
    assert moment is not None
    assert moment.sim_time_ns == TICK_NS
    assert moved.status() == {
        "sim_time_s": 0.05,
        "begin_s": 0.0,
        "end_s": 5.0,
        "paused": True,
        "speed": 1.0,
    }
    assert moved.due_s() == math.inf
    assert moved.do("resume", "", 3.0) is None
    assert moved.due_s() == pytest.approx(3.05)
    assert moved.do("seek", "5", 0.0) is not None
    assert moved.do("step", "", 0.0) is None  # there is no more


def test_steps_by_seconds_in_whole_ticks_and_not_past_the_end(run: Path) -> None:
    moved = controls(run)
    moved.next(0.0)
    for seconds, reached_s in (("2.01", 2.0), ("0.001", 2.05), ("60", 5.0)):
        moment = moved.do("step", seconds, 0.0)
        assert moment is not None
        assert moment.sim_time_ns == round(reached_s * S)
    assert moved.do("step", "1", 0.0) is None
    assert moved.pace.paused
    with pytest.raises(ValueError, match="above 0"):
        moved.do("step", "-1", 0.0)


def test_changes_its_speed(run: Path) -> None:
    moved = controls(run)
    moved.next(0.0)
    moved.do("speed", "5", 0.0)
    assert moved.due_s() == pytest.approx(0.01)
    moved.do("speed", "max", 0.0)
    assert moved.status()["speed"] == "max"
    moved.do("speed", "5", 0.0)
    moved.do("speed", "inf", 0.0)
    assert moved.status()["speed"] == "max"
    for wrong, why in {"0": "a factor, or max", "-1": "or max", "1e9": "or max", "fast": "a number"}.items():
        with pytest.raises(ValueError, match=why):
            moved.do("speed", wrong, 0.0)
    with pytest.raises(ValueError, match="'fly' is none of pause"):
        moved.do("fly", "", 0.0)


def test_pausing_keeps_the_moment(run: Path) -> None:
    moved = controls(run)
    moment = moved.next(0.0)
    assert moved.do("pause", "", 1.0) is None
    assert moved.do("status", "", 1.0) is None
    assert moved.player.now is moment
    assert moved.pace.paused


def test_a_step_at_the_end_plays_no_tick_beyond_it(run: Path) -> None:
    """Where it ends between two ticks."""
    moved = controls(run, 2 * S, 3 * S + TICK_NS // 2)
    assert played(moved)[-1] == 3 * S
    assert moved.do("step", "", 0.0) is None
    assert moved.status()["sim_time_s"] == 3.0
