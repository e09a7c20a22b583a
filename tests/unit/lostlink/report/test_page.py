"""The page of a report: whole, self-contained, and with a name for everything that is seen."""

from __future__ import annotations

import json
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest
from matplotlib.figure import Figure

from bridge.record.events import PROCESS_LEFT, Report
from bridge.record.tables.deliveries import no_deliveries
from bridge.run.directory import SUMMARY_FILE, RunDirectory
from channel.link.radio import Radio
from channel.presets import load_radio
from lostlink.flight.figure import CURVE_POINTS, draw_measured
from lostlink.flight.summary import Timing, summarise, write_summary
from lostlink.reading.rows import DeliveryRows
from lostlink.reading.run import load_run
from lostlink.report.content import KINDS, _model, content_of
from lostlink.report.page.page import LINKS_MAX, page_of
from lostlink.report.page.words import NOTHING
from lostlink.report.pictures.all import draw_all
from lostlink.report.pictures.radio import draw_ages, told_of_delivery
from tests.unit.lostlink.replay.flown import Sent, everybody, flown, scenario_of

PICTURES = {"map", "heights", "delivery", "powers", "matrix", "losses", "air_use", "age_matrix", "ages"}
VOID = {"meta", "br", "link", "img", "hr", "input"}


class Seen(HTMLParser):
    """What a page has; every element that is opened is closed in its turn."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def all(self, tag: str) -> list[dict[str, str | None]]:
        return [attrs for name, attrs in self.elements if name == tag]


@pytest.fixture(scope="module")
def content(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    path = tmp_path_factory.mktemp("runs") / "made"
    flown(
        path,
        scenario_of("moon2020", ("0", "1", "gcs"), extra="description: <script>alert(1)</script>\n"),
        ticks=200,
    )
    report = Report(path, "physics")
    report.event(5, "1", "stalled", "its autopilot <owes> a packet")
    report.may_not_repeat("wall time decided something")
    report.close()
    return content_of(load_run(path))


@pytest.fixture(scope="module")
def pictures(content: dict[str, Any]) -> dict[str, str]:
    return draw_all(content)


@pytest.fixture(scope="module")
def text(content: dict[str, Any], pictures: dict[str, str]) -> str:
    return page_of(content, pictures)


def test_it_asks_for_nothing(text: str):
    assert re.search(r"\b(https?|ftp|wss?):", text) is None
    assert "@import" not in text
    for _, attrs in Seen(text).elements:
        for name, value in attrs.items():
            if name in ("src", "href", "xlink:href", "action", "data", "srcset"):
                assert value is not None
                assert value.startswith(("#", "data:image/png;base64,"))
    assert re.search(r"url\((?!#)", text) is None
    assert "<script" not in text


def test_everything_seen_has_a_name(text: str, pictures: dict[str, str]):
    seen = Seen(text)
    drawn = [attrs for attrs in seen.all("svg") if attrs.get("class") == "picture"]
    assert len(drawn) == len(PICTURES)
    assert all(attrs["role"] == "img" and attrs["aria-label"] for attrs in drawn)
    assert all(attrs.get("scope") in ("col", "row") for attrs in seen.all("th"))
    assert len(seen.all("caption")) == len(seen.all("table")) == len(seen.all("thead"))
    ids = [attrs["id"] for _, attrs in seen.elements if "id" in attrs]
    assert len(ids) == len(set(ids))
    targets = {
        v[1:] for _, a in seen.elements for n, v in a.items() if n.endswith("href") and v and v[0] == "#"
    }
    assert targets <= set(ids)
    assert set(pictures) == PICTURES


def test_colours_are_those_of_the_page(text: str, pictures: dict[str, str]):
    style = text.split("</style>")[0]
    for name, picture in pictures.items():
        used = set(re.findall(r"var\((--[a-z0-9-]+)\)", picture))
        assert "--ink" in used
        assert all(f"{variable}: " in style for variable in used)
        assert "#0a0b" not in picture, name


def test_numbers_and_texts_are_there(content: dict[str, Any], text: str):
    assert "&lt;script&gt;alert(1)" in text
    assert "its autopilot &lt;owes&gt; a packet" in text
    assert "wall time decided something" in text
    assert f"{100 * content['totals']['delivery']:.1f} %" in text
    assert all(f">{link['tx']} to {link['rx']}<" in text for link in content["links"])


def test_the_same_numbers_give_the_same_bytes(content: dict[str, Any], text: str):
    again = json.loads(json.dumps(content, allow_nan=False))
    assert page_of(again, draw_all(again)) == text


def test_expectations_checks_and_failure_are_told(content: dict[str, Any]):
    checks = [{"name": "losses", "size": 1200, "found": 1.5, "chance": 1e-9, "passed": False}]
    missed = {
        "name": "delivery all to all",
        "type": "delivery",
        "wanted": "at least 0.9",
        "found": None,
        "unit": "",
    }
    judged = content | {"checks": checks, "expectations": [missed | {"passed": False}]}
    judged["run"] = content["run"] | {
        "outcome": "fail",
        "verdict": "fail: 1 of 1 checks",
        "error": "a host died",
    }
    text = page_of(judged, {})
    assert text.count('<span class="fail-word">FAILED</span>') == 2
    assert 'class="verdict fail">fail: 1 of 1 checks' in text
    assert "nothing of the kind" in text
    assert "a host died" in text


def test_of_many_links_the_worst_are_listed(tmp_path: Path):
    nodes = tuple(str(number) for number in range(14))
    made = content_of(load_run(flown(tmp_path / "run", scenario_of("moon2020", nodes), ticks=20)))
    text = page_of(made, {})
    assert len(made["links"]) == 182
    listed = text.split(' id="links"')[1].split("</section>")[0]
    assert len(re.findall(r"<th scope=\"row\">\d+ to \d+</th>", listed)) == LINKS_MAX
    assert f"The {LINKS_MAX} directed links of 182 that lose most" in text
    worst = min(made["links"], key=lambda link: link["delivery"])
    assert f">{worst['tx']} to {worst['rx']}<" in text


def test_of_many_links_the_ways_of_those_with_most_packets_are_told(content: dict[str, Any]) -> None:
    routes = [
        {"radio": "main", "tx": str(number), "rx": "gcs", "delivered": number, "hops_mean": 1.0, "changes": 0}
        | {"way": [str(number)], "share": 1.0}
        for number in range(LINKS_MAX + 30)
    ]
    text = page_of(content | {"routes": routes}, {})
    listed = re.findall(r"<th scope=\"row\">(\d+) to gcs</th>", text.split("By which nodes packets came")[-1])
    assert listed == [str(number) for number in reversed(range(30, LINKS_MAX + 30))]
    told = "By which nodes packets came: the most used way of each link, and its share"
    assert (
        f"{told}; the {LINKS_MAX} links of {LINKS_MAX + 30} on which most packets came, all are in the JSON"
        in text
    )
    few = page_of(content | {"routes": routes[:2]}, {})
    assert f"<caption>{told}</caption>" in few


def test_use_is_explained_where_it_is_drawn(content: dict[str, Any], pictures: dict[str, str]) -> None:
    [air] = content["air"]
    drawn = air | {"takes_time": True, "series": air["series"] | {"use_share": [0.1]}}
    use, routed = (
        "Use is the time in which frames are on the air",
        "Use is not drawn over time: nodes hand packets on",
    )
    for shown, has in (
        (air, (False, False)),
        (drawn, (True, False)),
        (air | {"takes_time": True, "is_routed": True}, (False, True)),
    ):
        text = page_of(content | {"air": [shown]}, pictures)
        assert (use in text, routed in text) == has


@pytest.mark.parametrize("ticks", [0, 1])
def test_a_run_that_hardly_began(tmp_path: Path, ticks: int):
    path = flown(tmp_path / "run", scenario_of("moon2020", ("0", "1")), ticks=ticks, killed=True)
    made = content_of(load_run(path))
    assert made["run"]["ending"] == "killed"
    assert made["totals"]["sent"] == 2 * ticks
    assert "This run has no end" in page_of(made, draw_all(made))


def test_a_killed_run_has_the_numbers_of_a_whole_one(tmp_path: Path):
    whole, killed = (
        content_of(
            load_run(flown(tmp_path / name, scenario_of("moon2020", ("0", "1")), killed=name == "killed"))
        )
        for name in ("whole", "killed")
    )
    for key in (
        "links",
        "totals",
        "losses",
        "ages",
        "powers",
        "nodes",
        "tracks",
        "separation_min_m",
        "model",
    ):
        assert killed[key] == whole[key], key
    assert (killed["run"]["ending"], whole["run"]["ending"]) == ("killed", "duration")


@pytest.mark.parametrize(
    ("radio", "are_shared"), [("moon2020", False), ("hata-qpsk", True), ("lte-uav", True)]
)
@pytest.mark.parametrize("nodes", [2, 4])
def test_packets_of_a_killed_run_that_share_what_is_drawn_have_no_intervals(
    tmp_path: Path, radio: str, are_shared: bool, nodes: int
) -> None:
    """By links, and of many links all together."""
    names = tuple(str(number) for number in range(nodes))
    made = content_of(load_run(flown(tmp_path / "run", scenario_of(radio, names), ticks=20, killed=True)))
    figure = Figure()
    draw_measured(figure.subplots(), made["bins"])
    assert bool(figure.axes[0].containers[0].has_yerr) is not are_shared
    assert ("no intervals" in told_of_delivery(made)) is are_shared


@pytest.mark.slow
def test_each_network_has_its_own_account_of_the_air(tmp_path: Path) -> None:
    """20 times a second node 0 gives 40 bytes to `main`; 0 and 1 give 500 each to `mesh`, where gcs is not."""
    scenario = scenario_of(
        "{preset: corrected, medium: {model: ideal}}",
        ("0", "1", "gcs"),
        extra="networks: {mesh: {preset: telemetry-915, medium: {model: airtime, queue: {packets: 1}}}}\n",
    )
    nodes = tuple(
        n.model_copy(update={"networks": ("main",)}) if n.node == "gcs" else n for n in scenario.nodes
    )
    big = [Sent(node, length=500, radio="mesh") for node in ("0", "1")]
    run = flown(
        tmp_path / "run", scenario.model_copy(update={"nodes": nodes}), 20, lambda _: [Sent("0"), *big]
    )
    content = content_of(load_run(run))
    main, mesh = content["air"]
    assert (main["radio"], main["medium"], main["packets"]) == ("main", "ideal", 20)
    assert (mesh["radio"], mesh["medium"], mesh["packets"]) == ("mesh", "airtime", 2 * 20)
    assert main["offered_bps"] == pytest.approx(20 * 40 * 8)
    assert mesh["offered_bps"] == pytest.approx(2 * 20 * 500 * 8)
    assert main["share"] < 0.01
    assert main["warning"] == ""
    assert mesh["share"] >= 160 / 64
    assert mesh["warning"].startswith("mesh: the nodes offered 160 kbit/s to the medium airtime")
    page = page_of(content, draw_all(content))
    assert "medium of main" in page
    assert "medium of mesh" in page
    summary = summarise(RunDirectory(run).scenario, RunDirectory(run), Timing(0.95, 1.0), "duration")
    assert [(each["radio"], each["packets"]) for each in summary["air"]] == [("main", 20), ("mesh", 40)]
    assert "; medium ideal; mesh: medium airtime, offered 2." in summary["verdict"]


def test_what_a_run_warns_of_is_on_its_page(tmp_path: Path) -> None:
    path = flown(tmp_path / "made", scenario_of("moon2020", ("0", "1")), 5)
    report = Report(path, "physics")
    report.event(5, "1", PROCESS_LEFT, "a <process> of its autopilot was left")
    report.close()
    run = RunDirectory(path)
    write_summary(summarise(run.scenario, run, Timing(0.2, 1.0), "duration"), run)
    content = content_of(load_run(path))
    assert content["warnings"] == ["a <process> of its autopilot was left"]
    told = page_of(content, {}).partition('id="judged"')[2].partition("</section>")[0]
    assert "<h3>Warnings</h3>\n<ul><li>a &lt;process&gt; of its autopilot was left</li></ul>" in told


def test_intervals_are_told_of_where_there_are_some(content: dict[str, Any]) -> None:
    told = told_of_delivery(content)
    assert "in steps of 20 m, with 99 % binomial (Clopper-Pearson) intervals, over the model" in told
    shared = [row | {"ci99": None, "predicted": 0.5} for row in content["bins"]]
    assert "(packets share shadowing, fading or the air: no intervals)" in told_of_delivery(
        content | {"bins": shared}
    )


def test_ages_of_less_than_a_decade_have_ticks_in_plain_numbers(content: dict[str, Any]) -> None:
    at_s = {"sim_time_s": [0.0, 1.0], "end_s": 2.0, "series": [{"name": "0 to 1", "age_s": [0.1, 0.3]}]}
    texts = re.findall(r">([^<>]+)</text>", draw_ages({"ages": at_s}))
    assert {"0.1", "0.2"} <= set(texts)
    assert not any("10^" in text for text in texts)


def test_a_run_that_ended_at_once_has_a_page_whose_routing_is_of_no_time(tmp_path: Path) -> None:
    scenario = scenario_of(
        "{preset: telemetry-915, medium: {model: airtime}, routing: {model: flood}}", ("0", "1")
    )
    path = flown(tmp_path / "made", scenario, 1, lambda _tick: [Sent("0", "1")])
    write_summary(summarise(scenario, RunDirectory(path), Timing(0.0, 1.0), "failed"), RunDirectory(path))
    text = page_of(content_of(load_run(path)), {})
    assert re.search(r"both on the air</th><td[^>]*>[\d.]+ s</td>", text)


@pytest.mark.slow
@pytest.mark.filterwarnings("error")
def test_names_that_are_long_are_shortened_in_pictures(tmp_path: Path) -> None:
    """Whole ones pushed the axes out of the picture, or were cut off at its edge."""
    long = "a_very_long_identifier_of_a_ground_station-with.dots_and-dashes1"
    path = flown(tmp_path / "run", scenario_of("moon2020", ("0", "1", long)), ticks=20)
    drawn = draw_all(content_of(load_run(path)))
    for name in ("map", "delivery", "matrix", "age_matrix", "ages"):
        texts = re.findall(r">([^<>]+)</text>", drawn[name])
        assert any("\u2026" in text for text in texts), name
        assert not any(long in text for text in texts), name


def test_the_ages_of_one_period_are_drawn(tmp_path: Path) -> None:
    path = flown(tmp_path / "run", scenario_of("moon2020", ("0", "1")), ticks=2)
    content = content_of(load_run(path))
    ages = content["ages"]
    assert (ages["sim_time_s"], ages["end_s"]) == ([0.0], 0.05)
    lines = re.findall(
        r'<path d="M ([^"]*)" [^>]*style="fill: none; stroke: var\(--series', draw_ages(content)
    )
    across = [line.split() for line in lines if len(set(line.split("L"))) > 1]
    assert len(across) >= len(ages["series"])


def test_beside_an_emitter_that_is_heard_the_curve_is_what_was_predicted() -> None:
    bins = [{"distance_min_m": 40.0, "distance_max_m": 60.0, "sent": 4, "predicted": 0.25}]
    nothing = DeliveryRows(("0", "1"), no_deliveries(("length_bytes", "radio", "packets")))
    alone = _model(scenario_of("sik-433", ("0", "1")), bins, nothing)
    beside = _model(scenario_of("sik-433", ("0", "1"), emitters=("jam",)), bins, nothing)
    assert alone is not None
    assert len(alone["distance_m"]) == CURVE_POINTS
    assert beside is not None
    assert (beside["distance_m"].tolist(), beside["probability_of_delivery"].tolist()) == ([50.0], [0.25])


def test_the_curve_is_that_of_the_packets_that_were_sent(tmp_path: Path) -> None:
    nodes = ("0", "1")
    run = flown(tmp_path / "run", scenario_of("corrected", nodes), 20, everybody(nodes, 328))
    model, radio = content_of(load_run(run))["model"], Radio(load_radio("corrected"))
    expected = radio.probability_of_delivery(model["distance_m"], 328)
    assert model["probability_of_delivery"] == pytest.approx(expected, abs=1e-3)
    assert expected[-1] < radio.probability_of_delivery(model["distance_m"][-1]) - 0.003


def test_places_that_are_no_numbers_are_dashes(content: dict[str, Any], pictures: dict[str, str]) -> None:
    """A flight model may diverge, and tables may be edited."""
    first, *others = content["nodes"]
    text = page_of({**content, "nodes": [{**first, "farthest_m": None}, *others]}, pictures)
    assert f"<td>{NOTHING}</td>" in re.sub(r"<td[^>]*>", "<td>", text)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("unfinished", -1),
        ("sim_duration_s", []),
        ("refused", "x"),
        ("bins", "x"),
        ("bins", [{}]),
        ("bins", [{"distance_min_m": None, "distance_max_m": 1.0, "sent": 1, "delivered": 1}]),
        ("checks", [{"name": "draws", "size": None}]),
        ("checks", [{"name": "draws", "size": 1, "found": []}]),
        ("unjudged", "x"),
        ("expectations", [{}]),
        ("warnings", "x"),
    ],
)
def test_a_summary_that_is_none_is_told_with_its_key(tmp_path: Path, key: str, value: object) -> None:
    path = flown(tmp_path / "made", scenario_of("moon2020", ("0", "1")), 5)
    (path / SUMMARY_FILE).write_text(json.dumps({key: value}))
    with pytest.raises(ValueError, match=rf"{SUMMARY_FILE}: {key}: not what a run writes"):
        content_of(load_run(path))


def test_a_summary_that_says_nothing_of_something_has_a_page(tmp_path: Path) -> None:
    path = flown(tmp_path / "made", scenario_of("moon2020", ("0", "1")), 5)
    (path / SUMMARY_FILE).write_text(json.dumps(dict.fromkeys(KINDS)))
    assert "What ran" in page_of(content_of(load_run(path)), {})
