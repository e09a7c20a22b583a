"""Charts: what is drawn is what is known, and no more points than a screen has."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from bridge.bus.messages import AircraftState
from bridge.record.tables.deliveries import FATES
from channel.link.radio import Radio
from channel.presets import load_radio
from lostlink.view.page.charts import (
    CAUSE_COLOURS,
    DARK,
    LIGHT,
    POINTS_MAX,
    ModelCurve,
    delivery_chart,
    link_chart,
    losses_chart,
    matrix_chart,
)
from lostlink.view.page.logged_chart import LINES_MAX, drawn_words, logged_chart
from lostlink.view.page.tables import (
    agent_rows,
    emitter_rows,
    fleet_rows,
    link_words,
    logged_rows,
    loss_rows,
    losses_words,
    place_words,
    status_words,
    time_words,
)
from lostlink.view.picture.link_history import DistanceBins, LinkHistory
from lostlink.view.picture.logged import Series
from lostlink.view.process import Model
from tests.unit.lostlink.replay.flown import scenario_of
from tests.unit.lostlink.view.fleet import (
    clock,
    emitter_at,
    fates,
    links,
    truths,
    view_of_two,
    with_emitter,
)


def test_the_chart_of_a_link_has_its_newest_report() -> None:
    history = LinkHistory(2)
    for number in range(1000):
        history.take(links(0.2 * number, 0.5 * number, 0.5, 4 * number, 2 * number))
    options = link_chart(history.series(0, 1), LIGHT)
    by_name = {series["name"]: series["data"] for series in options["series"]}
    assert list(by_name) == ["received power", "SNR", "measured", "model (1 - PER)"]
    assert by_name["measured"][-1] == [pytest.approx(199.8), 0.5]
    assert all(len(data) <= POINTS_MAX for data in by_name.values())


def test_small_numbers_are_drawn_as_they_are() -> None:
    """A frame of 802.11 takes half a millisecond, and what an agent logs may be smaller still."""
    logged = Series()
    for time_s, value in ((0.05, 4.321e-7), (3600.05, -0.000534), (3600.1, 12.3456)):
        logged.add(time_s, value)
    (drawn,) = logged_chart("a", [(0, "UA 0", logged)], LIGHT)["series"]
    assert drawn["data"] == [[0.05, 4.32e-7], [3600.05, -0.000534], [3600.1, 12.346]]


def test_the_chart_of_a_link_without_packets_is_empty() -> None:
    options = link_chart(LinkHistory(2).series(0, 1), LIGHT)
    assert [series["data"] for series in options["series"]] == [[], [], [], []]


def test_measured_deliveries_stand_in_their_intervals_beside_the_model() -> None:
    bins = DistanceBins(np.array([10.0, 30.0]), np.array([100.0, 50.0]), np.array([100.0, 20.0]))
    model = ModelCurve(np.array([0.0, 40.0]), np.array([1.0, 0.4]))
    options = delivery_chart(bins, model, DARK)
    measured, whiskers, curve = (series["data"] for series in options["series"])
    assert measured == [[10.0, 1.0], [30.0, 0.4]]
    # Clopper-Pearson, 99 %: 0.005^(1/100) = 0.948 for 100 of 100
    assert whiskers[:2] == [[10.0, 0.948], [10.0, 1.0]]
    assert whiskers[3][1] < 0.4 < whiskers[4][1]
    assert curve == [[0.0, 1.0], [40.0, 0.4]]
    assert options["textStyle"]["color"] == DARK.ink


def test_deliveries_that_share_what_is_drawn_have_no_intervals() -> None:
    bins = DistanceBins(np.array([10.0]), np.array([100.0]), np.array([60.0]))
    options = delivery_chart(bins, ModelCurve(np.empty(0), np.empty(0), shares_draws=True), LIGHT)
    assert [series["name"] for series in options["series"]] == ["measured", "model"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("radio", "are_shared"),
    [("moon2020", False), ("hata-qpsk", True), ("wifi-2.4", True), ("lte-uav", True)],
)
def test_the_model_knows_whether_packets_share_what_is_drawn(radio: str, are_shared: bool) -> None:
    curve = Model(scenario_of(radio, ("0", "1")), "main").curve(100.0, {})
    assert curve.shares_draws is are_shared
    assert curve.probability[0] > 0.9


def test_the_models_curve_is_that_of_the_packets_that_are_sent() -> None:
    scenario, radio = scenario_of("wifi-2.4", ("0", "1")), Radio(load_radio("wifi-2.4"))
    model = Model(scenario, "main")
    nominal = model.curve(3000.0, {})
    sent = model.curve(3000.0, {364: 9, 1536: 2})  # with the headers
    expected = radio.probability_of_delivery(sent.distance_m, 300)
    assert sent.probability == pytest.approx(expected)
    assert (sent.probability < nominal.probability - 0.02).any()


def test_a_models_curve_is_made_once_for_a_length_that_comes_back() -> None:
    model = Model(scenario_of("wifi-2.4", ("0", "1")), "main")
    short, long = {100: 9}, {1500: 9}
    first = model.curve(300.0, short)
    assert model.curve(300.0, long) is not first
    assert model.curve(300.0, short) is first
    assert model.curve(500.0, short).distance_m[-1] == 600.0


def test_a_matrix_is_drawn_at_once_however_many_nodes_it_has() -> None:
    chart = matrix_chart([str(node) for node in range(100)], np.ones((100, 100)), LIGHT)
    assert chart["series"][0]["progressive"] == 0


def test_each_network_has_its_models_curve() -> None:
    scenario = scenario_of("wifi-2.4", ("0", "1"), extra="networks: {tele: moon2020}\n")
    for network, preset in (("main", "wifi-2.4"), ("tele", "moon2020")):
        alone = Model(scenario_of(preset, ("0", "1")), "main").curve(600.0, {316: 1})
        assert alone.probability.size
        curve = Model(scenario, network).curve(600.0, {316: 1})
        assert (curve.probability == alone.probability).all()


def test_each_cause_has_a_colour_of_its_own() -> None:
    lost = set(FATES) - {"delivered"}
    assert lost <= set(CAUSE_COLOURS)
    assert len(set(CAUSE_COLOURS.values())) == len(CAUSE_COLOURS)


@pytest.mark.parametrize("nodes", [2, 50])
def test_all_charts_are_json(nodes: int) -> None:
    share = np.full((nodes, nodes), 0.5)
    np.fill_diagonal(share, np.nan)
    chart = matrix_chart([str(node) for node in range(nodes)], share, LIGHT)
    assert len(chart["series"][0]["data"]) == nodes * (nodes - 1)
    assert chart["yAxis"]["axisLabel"]["interval"] == (0 if nodes == 2 else 1)
    empty = DistanceBins(*(np.empty(0) for _ in range(3)))
    charts = (
        chart,
        losses_chart(np.empty(0), {}, LIGHT),
        delivery_chart(empty, ModelCurve(np.empty(0), np.empty(0)), LIGHT),
    )
    for options in charts:
        json.dumps(options, allow_nan=False)


def test_the_fleet_in_words() -> None:
    view = view_of_two()
    view.take(clock(1.0))
    view.take(truths(1.0, 250.0))
    view.take(fates(1.0, [(0, 1, 0), (1, 0, 1)]))
    ua, ground = fleet_rows(view, "main", chosen=0)
    assert (ua["node"], ua["north"], ua["height"], ua["hears"], ua["heard"]) == (
        "UA 0",
        "250.0",
        "40.0",
        "0/1",
        "1/1",
    )
    assert (ua["chosen"], ground["chosen"]) == (True, False)
    assert ground["mode"] == "-"
    view.take(AircraftState(mode="GROUND"), "gcs")
    assert fleet_rows(view, "main")[1]["mode"] == "GROUND"  # nothing to arm
    view.logged.take("0", "gap_m", 0, 12.3456)
    assert [row["logged"] for row in agent_rows(view)] == [1, 0]
    assert [(row["cause"], row["packets"]) for row in loss_rows(view.losses["main"])] == [
        ("delivered", 1),
        ("channel erasure", 1),
    ]


def test_an_autopilot_has_no_mode_before_its_first_heartbeat() -> None:
    view = view_of_two()
    view.take(AircraftState(), "0")
    assert fleet_rows(view, "main")[0]["mode"] == "disarmed"


def test_a_short_record_is_as_long_as_it_is() -> None:
    view = view_of_two()
    view.take(clock(0.4))
    view.duration_s = 0.45
    assert place_words(view) == "0.4 / 0.5 s"


@pytest.mark.parametrize(
    ("begin_s", "words"), [(0.5, ""), (47.25, "since 47.2 s of sim time, when a page was opened")]
)
def test_losses_say_from_when_on_they_are_counted(begin_s: float, words: str) -> None:
    view = view_of_two()
    assert losses_words(view.losses["main"]) == "no packet yet since this page is open"
    view.take(fates(begin_s, [(0, 1, 0)]))
    view.take(fates(begin_s + 5.0, [(0, 1, 1)]))
    assert losses_words(view.losses["main"]) == words


def test_a_link_in_words() -> None:
    view = view_of_two()
    assert link_words(view, "main", 0, 1) == "UA 0 to node gcs: no packet yet"
    view.take(links(1.0, 123.4, 0.25, 40, 30))
    assert link_words(view, "main", 0, 1) == (
        "UA 0 to node gcs: 123 m, -80.0 dBm, SNR 12.0 dB, probability of delivery 0.75; 30 of 40 packets delivered"
    )


def test_a_link_whose_latest_packet_found_no_room_in_words() -> None:
    view = view_of_two()
    view.take(links(1.0, np.nan, np.nan, 40, 30))
    assert link_words(view, "main", 0, 1) == (
        "UA 0 to node gcs: its latest packet never was on the air; 30 of 40 packets delivered"
    )


def test_how_time_goes_in_words() -> None:
    view = view_of_two()
    assert status_words(view, is_record=False) == "waits for the first tick"
    view.take(replace(clock(12.34), speed=2.0, real_time_factor=1.96, stalled=("0",)))
    assert time_words(view, is_record=False) == "12.3 s of sim time, 2.0 x real time"
    assert status_words(view, is_record=False) == "running; not waited for: 0"
    assert status_words(view, is_record=True) == "record, played 2 x"
    view.take(replace(clock(12.4), speed=np.inf, real_time_factor=np.inf))
    assert time_words(view, is_record=True) == "12.4 s of sim time"
    assert status_words(view, is_record=True) == "record, played as fast as possible"
    view.take(replace(clock(12.4), paused=True))
    assert status_words(view, is_record=True) == "record, paused"
    view.end()
    assert status_words(view, is_record=False) == "over"


def test_time_that_stands_still_is_told() -> None:
    now_s = 100.0
    view = view_of_two(now_s=lambda: now_s)
    assert status_words(view, is_record=False) == "waits for the first tick"
    view.take(clock(12.34))
    now_s += 2.9
    assert time_words(view, is_record=False) == "12.3 s of sim time, 1.0 x real time"
    assert status_words(view, is_record=False) == "running"
    now_s += 4.1
    assert time_words(view, is_record=False) == "12.3 s of sim time, stands still for 7 s"
    assert status_words(view, is_record=False) == "waits for a tick"
    assert time_words(view, is_record=True) == "12.3 s of sim time"
    view.take(clock(12.4))
    assert status_words(view, is_record=False) == "running"
    view.take(clock(12.4, paused=True))
    now_s += 60.0
    assert time_words(view, is_record=False) == "12.4 s of sim time, 1.0 x real time"
    assert status_words(view, is_record=False) == "paused"
    view.take(clock(12.4))
    now_s += 60.0
    view.end()
    assert time_words(view, is_record=False) == "12.4 s of sim time, 1.0 x real time"


def test_who_handed_a_packet_on_in_words() -> None:
    view = view_of_two()
    view.take(links(1.0, 123.4, 0.25, 40, 30))
    assert link_words(view, "main", 0, 1, (0,)).endswith("30 of 40 packets delivered, directly")
    assert link_words(view, "main", 0, 1, (0, 1)).endswith("30 of 40 packets delivered, by way of node gcs")


def test_delays_in_words() -> None:
    view = view_of_two()
    view.take(links(1.0, 123.4, 0.25, 40, 30))
    view.take(replace(fates(1.0, [(0, 1, 0)]), delay_s=(0.3504,)))
    assert link_words(view, "main", 0, 1).endswith("; 30 of 40 packets delivered, the latest after 0.350 s")
    assert [row["delay"] for row in fleet_rows(view, "main")] == ["-", "0.350"]


def test_what_an_agent_logged_in_words() -> None:
    view = view_of_two()
    view.logged.take("0", "plan", 1_250_000_000, {"north_m": [0, 1], "east_m": [2, 3]})
    estimate = {"north_m": 1.0, "east_m": 2.0, "covariance_m2": [4.0, 0.0, 1.0]}
    view.logged.take("0", "estimate", 1_300_000_000, estimate)
    assert logged_rows(view, "gcs") == []
    assert [tuple(row.values()) for row in logged_rows(view, "0")] == [
        (
            "estimate",
            "1.30",
            "north_m 1, east_m 2, covariance_m2 [4, 0, 1]",
            "ellipse, 95 %: 9.8 x 4.9 m",  # 2 sqrt(5.9915) times 2 m and 1 m
        ),
        ("plan", "1.25", "north_m [0, 1], east_m [2, 3]", "line of 2 points"),
    ]


def test_an_emitter_in_words() -> None:
    view = with_emitter()
    assert emitter_rows(view)[0]["north"] == "-"
    view.take(emitter_at(140.0))
    assert list(emitter_rows(view)[0].values()) == ["beacon", "433.92", "18.0", "140.0", "2.0", "3.0"]


def test_a_logged_number_has_a_line_per_node() -> None:
    series = Series()
    for number in range(2000):
        series.add(float(number), np.nan if number == 1999 else 2.0 * number)
    lines = [(place, f"UA {place}", series) for place in range(LINES_MAX + 3)]
    options = logged_chart("x", lines, DARK)
    assert [line["name"] for line in options["series"]] == [f"UA {place}" for place in range(LINES_MAX)]
    assert len(options["series"][0]["data"]) <= POINTS_MAX
    assert options["series"][0]["data"][-1] == [1999.0, None]
    assert (
        drawn_words(len(lines))
        == f"{LINES_MAX} of {LINES_MAX + 3} nodes that log it are drawn, the chosen one first"
    )
    assert drawn_words(LINES_MAX) == ""
    looks = {(line["color"], line["symbol"]) for line in options["series"]}
    assert len(looks) == LINES_MAX
    json.dumps(options, allow_nan=False)
    assert logged_chart("", [], LIGHT)["series"] == []
