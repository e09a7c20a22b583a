"""A record is read some rows at a time, as that of many UA is larger than memory: the numbers are the same."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from pathlib import Path

import pytest

from bridge.record.tables import reader
from bridge.scenario.file import read_scenario
from lostlink.expectations.judge import judge
from lostlink.reading.rows import RecordedDeliveries
from lostlink.reading.run import Run, load_run
from lostlink.redecision.redecide import redecide
from lostlink.replay.player import Player
from lostlink.report.content import content_of
from lostlink.report.side_by_side import side_by_side
from tests.unit.lostlink.replay.flown import TICK_NS, Router, Sent, everybody, flown, scenario_of, truths

NODES = ("0", "1", "2", "gcs")
MANY, TICKS = 12, 150
EXPECTED = (
    {"type": "delivery", "at_least": 0.5},
    {"type": "delivery", "from": 1, "each_link": True, "between_s": [0.5, 1.5], "at_least": 0.9},
    {"type": "delivery", "to": 0, "distance_m": [0, 400], "at_least": 0.9},
    {"type": "age", "node": 0, "at_most_s": 1},
    {"type": "age", "node": 1, "from": 0, "at_most_s": 1},
    {"type": "host_losses"},
)


def judgements(run: Run) -> object:
    separation = read_scenario("separation", {"expectations": list(EXPECTED)})
    return judge(run.path, run.scenario, "done", separation.expectations)


def figures(run: Run) -> object:
    return [content_of(run), side_by_side([run]), judgements(run), run.links.to_dict(), run.ages.to_dict()]


def played(run: Run) -> object:
    return sum(len(moment.fates().tx) for moment in Player.open(run.path).moments())


def decided_anew(run: Run) -> object:
    return redecide(run.path, seed=2).comparison.changed


def send(number: int) -> list[Sent]:
    """Some are lost before the channel, some are too long, and one goes to a node alone."""
    lost = 3 if number % 11 == 5 else 0
    return [
        *(Sent(node, lost=lost, length=5000 if number % 13 == 7 else 60) for node in NODES),
        Sent("0", to="1", length=30),
    ]


@pytest.mark.parametrize(
    "radio",
    [
        "moon2020",
        pytest.param("{preset: telemetry-915, medium: {model: csma, channels: {}}}", marks=pytest.mark.slow),
    ],
)
@pytest.mark.parametrize("killed", [False, True])
def test_in_parts_the_figures_are_those_of_all_rows_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, radio: str, killed: bool
) -> None:
    run = flown(tmp_path / "run", scenario_of(radio, NODES), 40, send, scale=0.3, killed=killed)
    whole = figures(load_run(run))
    monkeypatch.setattr(reader, "READ_ROWS", 7)
    assert figures(load_run(run)) == whole


@pytest.mark.parametrize(
    ("figure", "most"),
    [
        pytest.param(content_of, 200, marks=pytest.mark.slow),
        pytest.param(lambda r: side_by_side([r]), 100, marks=pytest.mark.slow),
        (judgements, 40),
        pytest.param(played, 100, marks=pytest.mark.slow),
        pytest.param(decided_anew, 650, marks=pytest.mark.slow),
    ],
)
def test_a_record_of_many_is_never_whole_in_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, figure: Callable[[Run], object], most: int
) -> None:
    nodes = [str(number) for number in range(MANY)]
    run = load_run(flown(tmp_path / "run", scenario_of("hata-qpsk", nodes), TICKS, scale=0.01))
    monkeypatch.setattr(reader, "READ_ROWS", 256)
    figure(run)
    tracemalloc.start()
    try:
        figure(run)
        peak_bytes = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak_bytes < most * MANY * (MANY - 1) * TICKS


def test_what_a_run_writes_after_it_was_first_asked_for_is_left_out(tmp_path: Path) -> None:
    router = Router(tmp_path / "run", scenario_of("moon2020", NODES))
    deliveries = RecordedDeliveries(router.run.path, NODES)
    counts = []
    for number in range(3):
        router.tick(
            number * TICK_NS, truths(scenario_of("moon2020", NODES), number), everybody(NODES)(number)
        )
        router.rows.flush()
        counts.append(sum(len(rows) for rows in deliveries.parts("seq")))
    router.close()
    assert counts == [12, 12, 12]
    assert sum(len(rows) for rows in deliveries.parts()) == 12
    assert sum(len(rows) for rows in RecordedDeliveries(router.run.path, NODES).parts()) == 36
