"""The figure of a run."""

from __future__ import annotations

from itertools import permutations
from pathlib import Path
from typing import Any

import pytest
from matplotlib.figure import Figure

from channel.link.radio import Radio
from channel.presets import load_radio, radio_from_mapping
from lostlink.flight.figure import CURVE_POINTS, LINKS_MAX, draw_probability_of_delivery, model_curve


def summary_of(nodes: int, sent: int = 40) -> dict[str, Any]:
    """Each link of so many nodes delivers its own share at two distances."""
    bins = [
        {
            "tx": str(tx),
            "rx": str(rx),
            "distance_min_m": start_m,
            "distance_max_m": start_m + 20.0,
            "sent": sent,
            "delivered": sent - tx,
            "measured": (sent - tx) / sent,
            "predicted": 1.0,
            "ci99": [0.9, 1.0],
        }
        for tx, rx in permutations(range(nodes), 2)
        for start_m in (0.0, 300.0)
    ]
    return {"bins": bins, "radio": "moon2020", "scenario": "made", "seed": 1}


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> list[Figure]:
    """Figures that were saved."""
    found: list[Figure] = []
    save = Figure.savefig

    def keep(figure: Figure, *args: Any, **options: Any) -> None:
        found.append(figure)
        save(figure, *args, **options)

    monkeypatch.setattr(Figure, "savefig", keep)
    return found


def legend_of(figure: Figure) -> list[str]:
    (axes,) = figure.axes
    legend = axes.get_legend()
    assert legend is not None
    return [text.get_text() for text in legend.get_texts()]


@pytest.mark.parametrize(("nodes", "entries"), [(2, 3), (3, 7), (4, 3), (20, 3)])
def test_a_legend_has_an_entry_per_link_of_a_few_and_one_for_many(
    nodes: int, entries: int, drawn: list[Figure], tmp_path: Path
) -> None:
    draw_probability_of_delivery(summary_of(nodes), Radio(load_radio("moon2020")), tmp_path / "figure.png")
    legend = legend_of(drawn[0])
    assert len(legend) == entries
    links = nodes * (nodes - 1)
    if links > LINKS_MAX:
        assert legend[1:] == [f"worst to best of {links} links", f"all {links} links"]
    else:
        assert legend[1] == "0 to 1"
    assert (tmp_path / "figure.png").stat().st_size > 5000


@pytest.mark.parametrize("nodes", [2, 4])
def test_links_of_several_networks_are_drawn_apart(nodes: int, drawn: list[Figure], tmp_path: Path) -> None:
    bins = summary_of(nodes)["bins"]
    both = [row | {"radio": name} for name in ("main", "telemetry") for row in bins]
    draw_probability_of_delivery(summary_of(nodes) | {"bins": both}, None, tmp_path / "figure.png")
    links = nodes * (nodes - 1)
    assert legend_of(drawn[0]) == (
        ["0 to 1, main", "1 to 0, main", "0 to 1, telemetry", "1 to 0, telemetry"]
        if links <= LINKS_MAX
        else [
            f"{what} {links} links, {name}"
            for what in ("worst to best of", "all")
            for name in ("main", "telemetry")
        ]
    )
    assert "main, telemetry" in drawn[0].axes[0].get_title()


def test_the_only_network_that_carried_packets_is_named_where_it_is_not_the_main_one(
    drawn: list[Figure], tmp_path: Path
) -> None:
    bins = [row | {"radio": "telemetry"} for row in summary_of(2)["bins"]]
    draw_probability_of_delivery(summary_of(2) | {"bins": bins}, None, tmp_path / "figure.png")
    assert legend_of(drawn[0]) == ["0 to 1, telemetry", "1 to 0, telemetry"]
    assert ": telemetry, seed" in drawn[0].axes[0].get_title()


def test_a_long_title_is_not_cut(drawn: list[Figure], tmp_path: Path) -> None:
    summary = summary_of(2)
    bins = [
        row | {"radio": name, "shares_draws": True}
        for name in ("main", "telemetry")
        for row in summary["bins"]
    ]
    made = summary | {"scenario": "a-scenario-with-a-rather-long-name-that-somebody-gave-it", "bins": bins}
    draw_probability_of_delivery(made, None, tmp_path / "figure.png")
    title = drawn[0].axes[0].title.get_window_extent()
    assert title.x0 >= 0.0
    assert title.x1 <= drawn[0].bbox.width


def test_many_links_are_drawn_as_their_mean_and_their_spread(drawn: list[Figure], tmp_path: Path) -> None:
    draw_probability_of_delivery(summary_of(4), None, tmp_path / "figure.png")
    (axes,) = drawn[0].axes
    spread, _ = axes.collections[0], axes.collections
    for segment in spread.get_segments():  # type: ignore[attr-defined]
        assert segment[:, 1].tolist() == [37 / 40, 1.0]
    points = axes.containers[0].lines[0]  # type: ignore[attr-defined]
    assert points.get_ydata().tolist() == pytest.approx([1 - 1.5 / 40] * 2)
    assert points.get_xdata().tolist() == [10.0, 310.0]


def test_beside_an_interferer_the_model_is_what_it_predicted_for_the_packets_of_a_bin() -> None:
    place = {"position_ned_m": [0.0, 50.0, -10.0], "power_dbm": 20.0}
    config = {"preset": "telemetry-915", "interference": {"interferers": [place]}}
    bins = summary_of(2)["bins"]
    for number, row in enumerate(bins):
        row |= {"predicted": 0.25 * number, "sent": 10 * (number + 1)}
    quiet, disturbed = Radio(load_radio("telemetry-915")), Radio(radio_from_mapping(config))
    assert len(model_curve(bins, quiet, 320.0)[0]) == CURVE_POINTS
    distance_m, predicted = model_curve(bins, disturbed, 320.0)
    assert distance_m == [10.0, 310.0]
    assert predicted == pytest.approx([(10 * 0.0 + 30 * 0.5) / 40, (20 * 0.25 + 40 * 0.75) / 60])


def test_the_model_is_that_of_the_runs_packets(drawn: list[Figure], tmp_path: Path) -> None:
    radio = Radio(load_radio("corrected"))
    draw_probability_of_delivery(summary_of(2), radio, tmp_path / "figure.png", 328)
    (axes,) = drawn[0].axes
    curve = next(line for line in axes.get_lines() if line.get_label() == "model")
    assert curve.get_ydata() == pytest.approx(radio.probability_of_delivery(curve.get_xdata(), 328))


@pytest.mark.parametrize(
    ("radio", "named"),
    [
        ("wifi-2.4", "wifi-2.4"),
        ({"preset": "elrs-2.4-333full"}, "elrs-2.4-333full"),
        ("/a/my.lab.yaml", "my.lab"),
    ],
)
def test_the_radio_is_named_whole(radio: Any, named: str, drawn: list[Figure], tmp_path: Path) -> None:
    draw_probability_of_delivery(summary_of(2) | {"radio": radio}, None, tmp_path / "figure.png")
    assert drawn[0].axes[0].get_title().startswith(f"made: {named}, seed 1")
