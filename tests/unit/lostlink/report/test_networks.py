"""A run whose nodes have two radios: what each carries is told apart in reports, tables of runs and studies."""

from __future__ import annotations

import pytest

from lostlink.reading.run import Run, load_run
from lostlink.report.content import content_of
from lostlink.report.page.page import page_of
from lostlink.report.pictures.all import draw_all
from lostlink.report.side_by_side import side_by_side, table_of
from lostlink.study.metrics import of_tables
from tests.unit.lostlink.replay.flown import Sent, flown, scenario_of

TICKS = 40


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """All of `main` arrives; by `c2` UA 1 sends every other tick, and the station is too far away."""
    c2 = "networks: {c2: {preset: wifi-2.4, transmit_power_dbm: -60}}\n"
    scenario = scenario_of("perfect", ("0", "1"), extra=c2)
    path = tmp_path_factory.mktemp("runs") / "run"

    def send(number: int) -> list[Sent]:
        return [Sent("0"), Sent("1"), *([Sent("1", radio="c2")] if number % 2 else [])]

    return load_run(flown(path, scenario, TICKS, send))


def test_counts_ages_and_latencies_are_of_each_network(run: Run) -> None:
    links = [("main", "0", "1"), ("main", "1", "0"), ("c2", "1", "0")]
    for frame in (run.links, run.ages, run.latencies):
        assert list(frame[["radio", "tx", "rx"]].itertuples(index=False, name=None)) == links
    assert run.links.sent.tolist() == [TICKS, TICKS, TICKS / 2]
    assert run.links.delivered.tolist() == [TICKS, TICKS, 0]
    assert run.latencies.delivered.tolist() == [TICKS, TICKS, 0]
    main_s, _, c2_s = run.ages.peak_s
    assert (main_s, c2_s) == (0.1, pytest.approx(run.end_ns / 1e9 - 0.05))  # since its first packet
    series = run.link_series(10.0)
    assert series.groupby("radio").sent.sum().to_dict() == {"main": 2 * TICKS, "c2": TICKS / 2}


def test_a_report_tells_the_links_of_each_network_apart(run: Run) -> None:
    content = content_of(run)
    told = [(link["radio"], link["tx"], link["delivery"]) for link in content["links"]]
    assert told == [("main", "0", 1.0), ("main", "1", 1.0), ("c2", "1", 0.0)]
    assert [each["name"] for each in content["ages"]["series"]] == [
        "main: 0 to 1",
        "main: 1 to 0",
        "c2: 1 to 0",
    ]
    assert [(each["radio"], each["sent"], each["delivery"]) for each in content["networks"]] == [
        ("main", 2 * TICKS, 1.0),
        ("c2", TICKS / 2, 0.0),
    ]
    page = page_of(content, draw_all(content))
    assert "<strong>100.0 %</strong><span>of 80 packets on main delivered</span>" in page
    assert "<strong>0.0 %</strong><span>of 20 packets on c2 delivered</span>" in page
    assert "greatest age of any link on c2" in page
    assert "c2: 1 to 0" in page
    assert "Share of packets delivered, on main." in page
    rows = {name: cells for name, cells, _ in table_of(side_by_side([run, run]))}
    assert (rows["delivery main: 1 to 0"], rows["delivery c2: 1 to 0"]) == (["100.0 %"] * 2, ["0.0 %"] * 2)


def test_a_study_has_a_column_for_the_links_of_each(run: Run) -> None:
    found = of_tables(run)
    assert (found["delivery_1_0"], found["delivery_c2_1_0"]) == (1.0, 0.0)
    assert found["sent"] == 2 * TICKS + TICKS / 2
