"""Expectations are judged by the tables of a run: each number here was worked out by hand."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import pytest
import yaml
from click.testing import CliRunner

from bridge.radio.ledger_file import LEDGER, Books, write_ledger
from bridge.record import names
from bridge.record.logged import LoggedValue, encode_logged
from bridge.record.streams import Entry
from bridge.run.directory import RunDirectory
from bridge.scenario.file import ScenarioError, read_scenario
from channel.medium.ledger import Ledger
from lostlink.cli.records.judge import judge as judge_command
from lostlink.expectations.judge import Judgement, judge
from lostlink.flight.summary import Timing, summarise, write_summary
from lostlink.reading.run import load_run
from lostlink.study.metrics import of_summary
from tests.unit.bridge.record.runs import TICK_NS, RunContent, make_run

FIRST, LOST_FROM, LOST_TO = 0, 5, 8
"""Of 20 ticks of 50 ms, UA 1 does not hear UA 0 at ticks 5, 6 and 7."""


def lose_some(made: RunContent) -> None:
    for index, row in enumerate(made.rows):
        tick = index // 2
        made.change_row(index, distance_m=10.0 * tick)
        if row.tx == "0" and LOST_FROM <= tick < LOST_TO:
            made.change_row(index, fate="channel_erasure")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_run(tmp_path_factory.mktemp("runs") / "run", lose_some)


def judged(run: Path, changes: Mapping[str, Any] = MappingProxyType({}), **expectation: Any) -> Judgement:
    scenario = read_scenario("separation", {**changes, "expectations": [expectation]})
    (judgement,) = judge(run, scenario, "done")
    return judgement


@pytest.mark.parametrize(
    ("expectation", "found", "passed"),
    [
        ({"from": 0, "to": 1, "at_least": 0.85}, 17 / 20, True),
        ({"from": 0, "to": 1, "at_least": 0.86}, 17 / 20, False),
        ({"from": 0, "to": 1, "at_most": 0.84}, 17 / 20, False),
        ({"to": 0, "at_least": 1}, 1.0, True),
        ({"at_least": 0.9}, 37 / 40, True),
        ({"at_least": 0.9, "each_link": True}, 17 / 20, False),
        ({"at_least": 0.5, "each_link": True}, 17 / 20, True),
        ({"at_most": 1, "each_link": True}, 1.0, True),
        ({"at_least": 0.8, "at_most": 1, "each_link": True}, 1.0, True),
        ({"from": 0, "distance_m": [50, 80], "at_least": 0.25, "at_most": 0.25}, 1 / 4, True),
        ({"from": 0, "between_s": [0.25, 0.35], "at_most": 0.1}, 0.0, True),
        ({"from": 0, "distance_m": [500, 600], "at_most": 0.1}, None, False),
    ],
)
def test_delivery(run: Path, expectation: dict[str, Any], found: float | None, passed: bool) -> None:
    judgement = judged(run, type="delivery", **expectation)
    assert judgement.found == (None if found is None else pytest.approx(found))
    assert judgement.passed is passed


def test_packets_of_one_radio_network_count_alone(tmp_path: Path) -> None:
    """Of 20 ticks UA 0 sends by `c2` at ticks 5, 6 and 7, and one packet comes, of tick 6; all of `main` come."""

    def by_two_radios(made: RunContent) -> None:
        lose_some(made)
        for tick in range(LOST_FROM, LOST_TO):
            made.change_row(2 * tick, radio="c2")
        made.change_row(2 * 6, fate="delivered")

    run = make_run(tmp_path / "run", by_two_radios)
    delivery = {"type": "delivery", "from": 0, "to": 1, "at_least": 0.9}
    changes = {"networks": {"c2": "wifi-2.4"}}
    assert judged(run, changes, **delivery).found == pytest.approx(18 / 20)
    assert judged(run, changes, **delivery, radio="main").found == 1.0
    of_c2 = judged(run, changes, **delivery, radio="c2")
    assert (of_c2.name, of_c2.found) == ("delivery 0 to 1 by c2", pytest.approx(1 / 3))
    age = judged(run, changes, type="age", node=1, radio="c2", at_most_s=1)
    assert (age.name, age.found) == (
        "age at 1 of what each other node sent by c2",
        pytest.approx(19 * 0.05 - 0.3),
    )
    with pytest.raises(
        ScenarioError, match=r"expectations.0.radio: no radio network has the name c3; there are: main, c2"
    ):
        judged(run, changes, **delivery, radio="c3")


def test_who_is_on_a_radio_network_is_heard_there_alone(run: Path) -> None:
    """A station that has no radio on `c2` sends nothing there: it is not what a node has never heard."""
    ears = {"id": "ears", "kind": "ground", "networks": ["main"], "agent": {"type": "still"}}
    nodes = [
        *({"id": n, "agent": {"type": "hold", "altitude_m": 40}, "home": {"north_m": 9 * n}} for n in (0, 1)),
        ears,
    ]
    changes = {"networks": {"c2": "wifi-2.4"}, "nodes": nodes}
    made = make_run(
        run.parent / "by_c2", lambda made: [made.change_row(row, radio="c2") for row in range(40)]
    )
    age = {"type": "age", "node": 1, "at_most_s": 0.2}
    assert judged(made, changes, **age, radio="c2").found == pytest.approx(0.1)
    assert judged(made, changes, **age).found == pytest.approx(0.95)
    for key, expectation in (("node", age | {"node": "ears"}), ("from", age | {"from": "ears"})):
        with pytest.raises(
            ScenarioError,
            match=rf"expectations.0.{key}: ears has no radio on the network c2; there are: 0, 1",
        ):
            judged(made, changes, **expectation, radio="c2")


def test_both_ends_of_an_interval_are_inside(tmp_path: Path) -> None:
    """2.05 s is tick 41, and 2.05 * 1e9 is less than its time; 8.3 * 1e9 is more than that of tick 166."""
    run = make_run(tmp_path / "run", lambda made: made.change_row(2 * 41, fate="channel_erasure"), ticks=170)
    for begin_s, until_s, found in ((0, 2.05, 41 / 42), (2.05, 2.05, 0.0), (8.3, 8.4, 1.0), (8.3, 8.3, 1.0)):
        assert judged(run, type="delivery", to=1, between_s=[begin_s, until_s], at_least=0.0).found == (
            pytest.approx(found, abs=1e-6)
        )


@pytest.mark.parametrize(
    ("expectation", "found", "passed"),
    [
        # tick 4's packet came at tick 5, the next, tick 8's, at tick 9
        ({"node": 1, "from": 0, "at_most_s": 0.25}, 0.25, True),
        ({"node": 1, "at_most_s": 0.24}, 0.25, False),
        ({"node": 0, "at_most_s": 0.1}, 0.1, True),
        ({"node": 1, "between_s": [0.3, 0.9], "at_most_s": 0.25}, 0.25, True),
        ({"node": 1, "between_s": [0, 0.3], "at_most_s": 0.2}, 0.1, True),
        ({"node": 1, "between_s": [5, 6], "at_most_s": 0.2}, None, False),
        # at an instant: a packet that comes then has come
        ({"node": 1, "from": 0, "between_s": [0, 0], "at_most_s": 0.1}, 0.0, True),
        ({"node": 1, "from": 0, "between_s": [0.25, 0.25], "at_most_s": 0.1}, 0.05, True),
        ({"node": 1, "from": 0, "between_s": [0.42, 0.42], "at_most_s": 0.2}, 0.22, False),
        ({"node": 1, "from": 0, "between_s": [0.95, 9], "at_most_s": 0.1}, 0.05, True),
    ],
)
def test_age(run: Path, expectation: dict[str, Any], found: float | None, passed: bool) -> None:
    judgement = judged(run, type="age", **expectation)
    assert judgement.found == (None if found is None else pytest.approx(found))
    assert judgement.passed is passed


def test_what_was_never_heard_is_as_old_as_the_run(tmp_path: Path) -> None:
    """Also over an interval that begins later: the age began anew there, and passed."""

    def lose_all(made: RunContent) -> None:
        for index, row in enumerate(made.rows):
            if row.tx == "0":
                made.change_row(index, fate="channel_erasure")

    silent = make_run(tmp_path / "run", lose_all)
    judgement = judged(
        silent, type="age", **{"node": 1, "from": 0, "between_s": [0.5, 0.8], "at_most_s": 0.4}
    )
    assert (judgement.found, judgement.passed) == (0.8, False)


@pytest.mark.parametrize(
    ("expectation", "found", "passed"),
    [  # UA 1 is at t + 1 m north and 10 m high; the last tick is at 0.95 s
        ({"north_m": 1.95, "east_m": 0}, 0.0, True),
        ({"north_m": 1.95, "east_m": 3, "height_m": 6}, 5.0, False),
        ({"north_m": 0, "east_m": 0, "at": "ever"}, 1.0, True),
        ({"north_m": 0, "east_m": 0, "at": "always"}, 1.95, False),
        ({"north_m": 0, "east_m": 0, "at": 0.5}, 1.5, True),
        ({"north_m": 0, "east_m": 0, "at": 9}, None, False),
    ],
)
def test_position(run: Path, expectation: dict[str, Any], found: float | None, passed: bool) -> None:
    judgement = judged(run, type="position", node=1, within_m=1.9, **expectation)
    assert judgement.found == (None if found is None else pytest.approx(found))
    assert judgement.passed is passed


def test_separation(tmp_path: Path) -> None:
    run = make_run(tmp_path / "run")
    assert judged(run, type="separation", at_least_m=0.5).found == pytest.approx(1.0)
    assert not judged(run, type="separation", at_least_m=1.5, among=[1, 0]).passed
    assert judged(run, type="separation", at_least_m=1.5, between_s=[7, 8]).found is None
    assert judged(run, type="separation", at_most_m=1.0).passed
    farther = judged(run, type="separation", at_least_m=0.5, at_most_m=0.9)
    assert (farther.found, farther.passed, farther.wanted) == (1.0, False, "at least 0.5 m and at most 0.9 m")
    with pytest.raises(ScenarioError, match="give at_least_m, at_most_m or both"):
        judged(run, type="separation")


def test_while_an_autopilot_stands_still_its_aircraft_is_where_it_was(tmp_path: Path) -> None:
    """UA 1 has no truth from 0.25 s to 0.7 s, and is 1.2 m north then, which UA 0 comes near to at 1 m/s."""

    def stall(made: RunContent) -> None:
        stood = range(5 * TICK_NS, 15 * TICK_NS)
        made.truths = [
            each for each in made.truths if each.header.frame_id != "1" or each.header.stamp.ns not in stood
        ]

    run = make_run(tmp_path / "run", stall)
    assert judged(run, type="separation", at_least_m=0.6).found == pytest.approx(0.5)
    assert judged(run, type="separation", at_least_m=0.6, between_s=[0.3, 0.6]).found == pytest.approx(0.6)
    place = {"node": 1, "north_m": 0.0, "east_m": 0.0, "within_m": 9.0}
    assert judged(run, type="position", at=0.5, **place).found == pytest.approx(1.2)


def test_what_never_was_on_the_air_counts_at_the_distance_at_which_it_was_sent(tmp_path: Path) -> None:
    """UA fly 1 m apart: of 20 packets 4 found no room, one was longer than the radio takes, one was the host's."""

    def lose(made: RunContent) -> None:
        for index in range(0, 8, 2):
            made.change_row(index, fate="queue_full", distance_m=float("nan"))
        made.change_row(8, rx="all", fate="too_long", distance_m=float("nan"))
        made.change_row(10, rx="all", fate="transport", distance_m=float("nan"))

    run = make_run(tmp_path / "run", lose)
    link = {"type": "delivery", "from": 0, "to": 1, "at_least": 0}
    assert judged(run, **link).found == 14 / 20
    assert judged(run, **link, distance_m=[0.9, 1.1]).found == 0.0
    assert judged(run, **link, distance_m=[0.9, 100]).found == pytest.approx(14 / 19, abs=1e-6)


def test_losses_of_the_host_count_each_receiver(tmp_path: Path) -> None:
    def lose(made: RunContent) -> None:
        made.change_row(0, fate="transport")
        made.change_row(3, rx="all", packets=4, fate="transport", distance_m=float("nan"))

    run = make_run(tmp_path / "run", lose)
    assert judged(run, type="host_losses").found == 5
    assert judged(run, type="host_losses", at_most=5).passed
    assert judged(run, **{"type": "delivery", "from": 1, "to": 0, "at_least": 0}).found == pytest.approx(
        19 / 23
    )


def test_ending_and_names(run: Path) -> None:
    assert judged(run, type="ending", ending="done").passed
    assert not judged(run, type="ending", ending="duration", name="runs on").passed
    assert judged(run, type="ending", ending="done", name="comes home").name == "comes home"


def test_a_record_is_judged_by_another_scenario(tmp_path: Path) -> None:
    run = make_run(tmp_path / "run", lose_some, is_finished=False)
    RunDirectory(run).write(read_scenario("separation"), "tcp/127.0.0.1:1")
    done = CliRunner().invoke(judge_command, [str(run)])
    assert (done.exit_code, done.output) == (0, "the scenario expects nothing\n")
    other = tmp_path / "other.yaml"
    wanted = {"extends": "separation", "expectations": [{"type": "delivery", "from": 0, "at_least": 0.9}]}
    other.write_text(yaml.safe_dump(wanted))
    done = CliRunner().invoke(judge_command, [str(run), str(other)])
    assert (done.exit_code, done.output) == (
        3,
        "FAILED: delivery 0 to all: wanted at least 0.9, found 0.85\n",
    )
    wanted["without"] = [1]
    wanted["nodes"] = [{"id": 7, "agent": {"type": "still"}}]
    wanted["expectations"] = [{"type": "age", "node": 7, "at_most_s": 1}]
    other.write_text(yaml.safe_dump(wanted))
    done = CliRunner().invoke(judge_command, [str(run), str(other)])
    assert (done.exit_code, "has no node 7" in done.output) == (2, True)


def log(made: RunContent) -> None:
    """UA 0 logs 0, 1, ... 9 as `error_m`, UA 1 ten times 2; and a mapping, and a text."""
    for node in ("0", "1"):
        values = [LoggedValue("error_m", float(tick) if node == "0" else 2.0) for tick in range(10)]
        entries = [Entry(tick * 50_000_000, encode_logged(value)) for tick, value in enumerate(values)]
        others = (
            LoggedValue("plan", {"to_m": 7.5, "why": "lost", "at": [1.0, 9.0]}),
            LoggedValue("say", "no"),
        )
        entries += [Entry(500_000_000, encode_logged(value)) for value in others]
        made.streams[names.logged(node)] = entries


@pytest.mark.parametrize(
    ("expectation", "found", "passed"),
    [
        ({"value": "error_m", "at_most": 8, "for": 0.9}, 0.9, True),
        ({"value": "error_m", "at_most": 8, "for": 0.95}, 0.9, False),
        ({"value": "error_m", "at_most": 8}, 0.9, False),
        ({"value": "error_m", "at_most": 8, "node": 1}, 1.0, True),
        ({"value": "error_m", "at_least": 3, "at_most": 4, "for": 0.2, "node": 0}, 0.2, True),
        ({"value": "error_m", "at_least": 3, "between_s": [0.15, 0.45], "node": 0}, 1.0, True),
        ({"value": "plan", "key": "to_m", "at_least": 7}, 1.0, True),
        ({"value": "plan", "key": "at.1", "at_least": 9}, 1.0, True),
        ({"value": "nobody_logs_it", "at_least": 7}, None, False),
    ],
)
def test_logged(tmp_path: Path, expectation: dict[str, Any], found: float | None, passed: bool) -> None:
    judgement = judged(make_run(tmp_path / "run", log), type="logged", **expectation)
    assert judgement.found == (None if found is None else pytest.approx(found))
    assert judgement.passed is passed


@pytest.mark.parametrize(
    ("expectation", "says"),
    [
        ({"value": "say"}, "no number$"),
        ({"value": "plan"}, "no number: give one of the keys to_m, why, at.0, at.1$"),
        ({"value": "plan", "key": "why"}, "no number under 'why'"),
        ({"value": "plan", "key": "at"}, "no number under 'at': give one of the keys to_m, why, at.0, at.1$"),
    ],
)
def test_what_is_logged_and_is_no_number_is_told(
    tmp_path: Path, expectation: dict[str, Any], says: str
) -> None:
    judgement = judged(make_run(tmp_path / "run", log), type="logged", at_most=1, **expectation)
    assert not judgement.passed
    assert re.search(f"^node 0 logged .* at 0.5 s, which has {says}", judgement.error)


MEASURES = """
def ticks(run, more=0):
    return len(set(run.columns("truth", ["tick_ns"])["tick_ns"])) + more

def grows(run):
    return True

def several(run):
    import numpy
    return numpy.zeros(3)

def nothing(run):
    return float("nan")

def quits(run):
    raise SystemExit(3)

def breaks(run):
    return 1 / 0

class Last:
    def __new__(cls, run):
        return run.end_ns / 1e9
"""


@pytest.mark.parametrize(
    ("expectation", "found", "passed"),
    [
        ({"function": "ticks", "at_most": 20}, 20.0, True),
        ({"function": "ticks", "at_most": 20, "options": {"more": 1}}, 21.0, False),
        ({"function": "grows"}, "yes", True),
        ({"function": "Last", "at_least": 0.95}, 0.95, True),
    ],
)
def test_function(tmp_path: Path, expectation: dict[str, Any], found: float | str, passed: bool) -> None:
    (tmp_path / "mine.py").write_text(MEASURES)
    run = make_run(tmp_path / "run")
    RunDirectory(run).write(read_scenario("separation"), "tcp/127.0.0.1:1")
    named = expectation | {"function": f"{tmp_path / 'mine.py'}:{expectation['function']}"}
    judgement = judged(run, type="function", **named)
    assert (judgement.found, judgement.passed) == (found, passed)


@pytest.mark.parametrize(
    ("expectation", "words"),
    [
        (
            {"function": "several", "at_most": 1},
            "several raised ValueError: can only convert an array of size 1",
        ),
        ({"function": "nothing", "at_most": 1}, "gave nan; wanted is a number"),
        ({"function": "breaks", "at_most": 1}, "breaks raised ZeroDivisionError: division by zero"),
        ({"function": "quits", "at_most": 1}, "quits raised SystemExit: 3"),
        ({"function": "ticks"}, "gave 20; wanted is True or False, or bounds for a number"),
        ({"function": "grows", "at_most": 1}, "gave True; wanted is a number"),
    ],
)
def test_a_function_that_says_nothing_to_judge_fails_and_is_told(
    tmp_path: Path, expectation: dict[str, Any], words: str
) -> None:
    (tmp_path / "mine.py").write_text(MEASURES)
    run = make_run(tmp_path / "run")
    RunDirectory(run).write(read_scenario("separation"), "tcp/127.0.0.1:1")
    named = expectation | {
        "type": "function",
        "function": f"{tmp_path / 'mine.py'}:{expectation['function']}",
    }
    judgement = judged(run, **named)
    assert not judgement.passed
    assert words in judgement.error


def test_a_function_that_is_not_there_is_found_before_a_flight(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(MEASURES)
    (tmp_path / "wants.yaml").write_text(
        "extends: separation\nexpectations:\n  - {type: function, function: mine.py:tics, at_most: 1}\n"
    )
    with pytest.raises(
        ScenarioError, match=r"wants.yaml:3: expectations.0.function: .*mine.py has no function tics"
    ):
        read_scenario(str(tmp_path / "wants.yaml"))


def test_expectations_have_columns_in_a_study(tmp_path: Path) -> None:
    run = make_run(tmp_path / "run")
    directory = RunDirectory(run)
    wanted = [
        {"type": "separation", "at_most_m": 0.5, "name": "together"},
        {"type": "ending", "ending": "done"},
    ]
    scenario = read_scenario("separation", {"expectations": wanted})
    directory.write(scenario, "tcp/127.0.0.1:1")
    write_ledger(run / LEDGER, [Books(Ledger(("0", "1")))], {})
    write_summary(summarise(scenario, directory, Timing(1.0, 1.0), "done"), directory)
    found = of_summary(load_run(run))
    assert {name: value for name, value in found.items() if ": " in name} == {
        "together: found": pytest.approx(1.0),
        "together: passed": False,
        "ending: found": "done",
        "ending: passed": True,
    }
    assert (found["passed"], found["outcome"]) == (False, "fail")
