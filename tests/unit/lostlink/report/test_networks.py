"""A run whose nodes have two radios: what each carries is told apart in reports, tables of runs and studies."""

from __future__ import annotations

from pathlib import Path

import pytest

from lostlink.reading.ages import times_of
from lostlink.reading.rows import RecordedDeliveries
from lostlink.reading.run import Run, load_run
from lostlink.report.content import content_of
from lostlink.report.packets import ages_of
from lostlink.report.page.page import page_of
from lostlink.report.pictures.all import draw_all
from lostlink.report.scales import plain
from lostlink.report.side_by_side import comparison_page, side_by_side, table_of
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
    assert "Share of packets delivered on c2." in page
    rows = {name: cells for name, cells, _ in table_of(side_by_side([run, run]))}
    assert (rows["delivery main: 1 to 0"], rows["delivery c2: 1 to 0"]) == (["100.0 %"] * 2, ["0.0 %"] * 2)


def test_losses_powers_and_air_of_a_report_are_of_each_network(run: Run) -> None:
    content = content_of(run)
    main, c2 = content["networks"]
    assert (main["losses"]["lost"], sum(main["losses"]["delivered"])) == ({}, 2 * TICKS)
    assert {cause: sum(each) for cause, each in c2["losses"]["lost"].items()} == c2["lost"]
    assert sum(c2["losses"]["delivered"]) == 0
    assert sum(box["packets"] for box in main["powers"]["boxes"]) == 2 * TICKS
    assert sum(box["packets"] for box in c2["powers"]["boxes"]) == TICKS / 2
    pictures = draw_all(content)
    for name in ("losses", "powers", "matrix", "age_matrix", "air_use"):
        assert f"{name}-main" in pictures
        assert name not in pictures
    page = page_of(content, pictures)
    assert sum(c2["lost"].values()) == TICKS / 2
    for cause, lost in c2["lost"].items():
        cells = f'<td class="number">{lost}</td><td class="number">{100 * lost / (TICKS / 2):.1f} %</td>'
        assert f'<th scope="row">c2: {cause.replace("_", " ")}</th>{cells}' in page
    assert "Packets on c2 by what became of them" in page
    assert "Load and use of the air on c2." in page
    assert page.count("<figure>") == len(pictures)


def test_of_many_links_ages_over_time_are_of_each_network(run: Run) -> None:
    deliveries = RecordedDeliveries(run.path, run.nodes, ("main", "c2"))
    times = times_of(deliveries)
    found = ages_of(times * 3, deliveries, run.end_ns)
    peaks = {
        each["name"]: max(age for age in each["age_s"] if age is not None) for each in plain(found["series"])
    }
    silent_s = pytest.approx(run.end_ns / 1e9 - 0.05)
    assert peaks == {
        "main: median of 6 links": 0.1,
        "main: the oldest of all": 0.1,
        "c2: median of 3 links": silent_s,
        "c2: the oldest of all": silent_s,
    }


def test_runs_side_by_side_have_figures_and_lines_of_each_network(run: Run) -> None:
    content = side_by_side([run, run])
    rows = {name: cells for name, cells, _ in table_of(content)}
    assert rows["main: share delivered"] == ["100.0 %"] * 2
    assert rows["c2: share delivered"] == ["0.0 %"] * 2
    assert "share delivered" not in rows
    main, c2 = content["runs"][0]["networks"]
    assert sum(point["delivered"] for point in main["delivery_by_distance"]) == 2 * TICKS
    assert sum(point["delivered"] for point in c2["delivery_by_distance"]) == 0
    assert "run, c2" in comparison_page(content)


def test_a_study_has_a_column_for_the_links_of_each(run: Run) -> None:
    found = of_tables(run)
    assert (found["delivery_1_0"], found["delivery_c2_1_0"]) == (1.0, 0.0)
    assert found["sent"] == 2 * TICKS + TICKS / 2


def test_the_one_of_several_that_carried_packets_is_named(tmp_path: Path) -> None:
    scenario = scenario_of("perfect", ("0", "1"), extra="networks: {c2: {preset: perfect, base_loss: 0.5}}\n")
    run = load_run(flown(tmp_path / "run", scenario, TICKS, lambda _number: [Sent("1", radio="c2")]))
    content = content_of(run)
    assert [each["name"] for each in content["ages"]["series"]] == ["c2: 1 to 0"]
    pictures = draw_all(content)
    page = page_of(content, pictures)
    assert "packets on c2 delivered" in page
    assert "Packets on c2 by what became of them" in page
    assert "c2: base loss" in page
    assert page.count("<figure>") == len(pictures)
    both = side_by_side([run, run])
    assert {"c2: share delivered", "delivery c2: 1 to 0"} <= {name for name, _, _ in table_of(both)}
    assert "run, c2" in comparison_page(both)
