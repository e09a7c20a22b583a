"""What agents logged: the newest of each name, numbers over time, shapes; bounded, whatever comes."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lostlink.view.picture.logged import (
    NAMES_MAX,
    POINTS_MAX,
    SERIES_MAX,
    SHAPES_MAX,
    TEXT_MAX,
    Logged,
    Series,
    described,
)
from lostlink.view.picture.shapes import Line

S = 1_000_000_000
LINE = {"north_m": [0.0, 1.0], "east_m": [0.0, 1.0]}


def taken(*values: Any, name: str = "x") -> Logged:
    """What is known after values, one a second."""
    logged = Logged(("0", "1"))
    for second, value in enumerate(values):
        logged.take("0", name, second * S, value)
    return logged


def test_the_newest_value_is_shown_with_its_time() -> None:
    latest = taken(1.5, 2.5).latest
    assert (latest["0"]["x"].sim_time_ns, latest["0"]["x"].text) == (S, "2.5")
    assert not latest["1"]


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (12.3456789, "12.3457"),
        (7, "7"),
        (True, "yes"),
        (None, "-"),
        ("to the north", "to the north"),
        ([1.0, 2.5], "[1, 2.5]"),
        (list(range(9)), "[0, 1, 2, 3, ... (9)]"),
        ({"leg": 2, "to_m": [1.0, 2.0], "why": "lost link"}, "leg 2, to_m [1, 2], why lost link"),
        ({}, "{}"),
        ({"deep": {"er": 1}}, "deep ..."),
    ],
)
def test_values_in_words(value: Any, text: str) -> None:
    assert described(value) == text


def test_numbers_are_kept_over_time_also_those_in_mappings() -> None:
    logged = taken(
        {"north_m": 1.0, "n": 2, "why": "x", "at": [1.0]}, {"north_m": None, "n": 3, "is_fine": True}
    )
    assert list(logged.series["0"]) == ["x: north_m", "x: n", "x: is_fine"]
    time_s, north_m = logged.series["0"]["x: north_m"].points()
    assert time_s.tolist() == [0.0, 1.0]
    assert north_m[0] == 1.0
    assert math.isnan(north_m[1])


@pytest.mark.parametrize("count", [0, 1, POINTS_MAX - 1, POINTS_MAX, 10 * POINTS_MAX + 7])
def test_a_series_is_thinned_and_has_its_newest_value(count: int) -> None:
    series = Series()
    for number in range(count):
        series.add(float(number), 2.0 * number)
    time_s, value = series.points()
    assert len(time_s) <= POINTS_MAX
    assert len(time_s) >= min(count, POINTS_MAX // 2)
    assert (value == 2.0 * time_s).all()
    assert (time_s[1:] > time_s[:-1]).all()
    if count:
        assert time_s[-1] == count - 1


def test_shapes_change_only_when_they_do() -> None:
    logged = taken(LINE, LINE, name="plan")
    assert logged.changes == 1
    assert logged.shapes["0", "plan"] == (1, Line(((0.0, 0.0), (1.0, 1.0))))
    logged.take("0", "plan", 3 * S, "none any more")
    assert logged.shapes["0", "plan"] == (2, None)
    assert logged.latest["0"]["plan"].shape is None


def test_names_and_series_have_an_end() -> None:
    logged = Logged(("0", "1"))
    for number in range(NAMES_MAX + 5):
        logged.take("0", f"n{number}", 0, {"a": 1.0, "b": 2.0})
    logged.take("1", "x", 0, 1.0)
    assert (len(logged.latest["0"]), len(logged.latest["1"])) == (NAMES_MAX, 1)
    assert logged.passed_over == {"0": 5}
    assert len(logged.series["0"]) == SERIES_MAX
    logged.take("0", "n3", S, 5.0)  # known names go on
    assert logged.latest["0"]["n3"].text == "5"


def test_shapes_have_an_end_and_room_beside_other_names() -> None:
    logged = Logged(("0", "1"))
    for number in range(NAMES_MAX):
        logged.take("0", f"n{number}", 0, 1.0)
    for number in range(100):
        logged.take("0", f"line{number}", 0, LINE)
    logged.take("1", "plan", 0, LINE)
    drawn = [f"line{number}" for number in range(SHAPES_MAX)]
    assert list(logged.shapes) == [*(("0", name) for name in drawn), ("1", "plan")]
    assert len(logged.latest["0"]) == NAMES_MAX + SHAPES_MAX
    logged.take("0", "line3", S, 5.0)  # it gives its place free
    logged.take("0", "n7", S, LINE)
    assert logged.shapes["0", "n7"][1] is not None


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda children: (
        st.lists(children) | st.dictionaries(st.text() | st.sampled_from(["north_m", "east_m"]), children)
    ),
)


@pytest.mark.slow
@settings(max_examples=50)
@given(st.lists(JSON, max_size=5))
def test_any_value_is_taken(values: list[Any]) -> None:
    logged = taken(*values)
    if values:
        assert len(logged.latest["0"]["x"].text) <= TEXT_MAX


def test_what_is_of_nobody_here_is_passed_over() -> None:
    logged = Logged(("0",))
    logged.take("7", "x", 0, 1.0)
    assert list(logged.latest) == ["0"]
    assert not logged.latest["0"]
