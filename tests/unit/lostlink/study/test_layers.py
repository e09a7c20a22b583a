"""What a study sets, over what it sets for all runs: a whole does not erase settings of its parts."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from lostlink.study.cases import cases_of, laid_over
from lostlink.study.model import StudyFile

BASE_LOSS = {"radio.base_loss": 0.4}


@pytest.mark.parametrize(
    "study",
    [
        {"set": BASE_LOSS, "vary": {"radio": ["wifi-2.4"]}},
        {"set": BASE_LOSS, "cases": {"a": {"radio": {"preset": "wifi-2.4"}}}},
        {"vary": {"radio.base_loss": [0.4], "radio": ["wifi-2.4"]}},
        {"cases": {"lossy": BASE_LOSS}, "vary": {"radio": ["wifi-2.4"]}},
    ],
)
def test_a_whole_radio_leaves_its_settings(study: dict[str, Any]) -> None:
    file = StudyFile.model_validate({"schema": 1, "name": "mine", "scenario": "separation", **study})
    (case,) = cases_of(file, Path())
    assert case.scenario.radio == {"preset": "wifi-2.4", "base_loss": 0.4}


def test_what_a_later_whole_says_holds() -> None:
    later = {"radio": {"preset": "corrected", "base_loss": 0.1, "noise": {"floor_dbm": -90}}}
    earlier = {"radio.base_loss": 0.4, "radio.noise.floor_dbm": -80, "radio.noise.bandwidth_hz": 1e6}
    assert list(laid_over(earlier, later).items()) == [*later.items(), ("radio.noise.bandwidth_hz", 1e6)]


def test_the_last_layer_with_a_key_holds() -> None:
    assert laid_over({"seed": 1, "a.b": 1}, {"a.b": 2}, {"a.b": 3}) == {"seed": 1, "a.b": 3}


def test_what_a_later_layer_says_of_all_nodes_holds_for_each() -> None:
    of_one = {"nodes.1.home.alt_m": 2, "nodes.1.home.north_m": 7}
    laid = laid_over({"nodes.*.home.alt_m": 1}, of_one, {"nodes.*.home.alt_m": 3})
    assert laid == {"nodes.1.home.north_m": 7, "nodes.*.home.alt_m": 3}
    whole = {"nodes.*.agent": {"options": {"speed_mps": 5}}}
    earlier = {"nodes.1.agent.options.speed_mps": 9, "nodes.1.agent.options.legs": 2}
    assert laid_over(earlier, whole) == {**whole, "nodes.1.agent.options.legs": 2}
    assert list(laid_over({"nodes.*.radio": "a"}, {"nodes.1.radio": "b"})) == [
        "nodes.*.radio",
        "nodes.1.radio",
    ]
