"""A study by setting: means and their errors by numpy."""

from __future__ import annotations

import math
from itertools import permutations

import numpy as np
import pytest

from lostlink.study.metrics import link_column
from lostlink.study.settings import Mean, by_setting, mean_of

LABELS = ["scenario", "case", "radio", "seed"]
FAR_M = {"a": [10.0, 14.0, 21.0], "b": [5.0, 5.0, float("nan")]}


def rows() -> list[dict[str, object]]:
    common = {"scenario": "one", "case": "", "id": "x", "failure": "", "sent": 5, "delivery_0_1": 0.5}
    flown: list[dict[str, object]] = [
        {**common, "radio": radio, "seed": seed, "passed": seed != 2, "delivery": 0.25 * seed, "far_m": far_m}
        for radio, fars in FAR_M.items()
        for seed, far_m in enumerate(fars, start=1)
    ]
    return [
        *flown,
        {**{name: common[name] for name in ("scenario", "case")}, "radio": "b", "seed": 4, "failure": "x"},
    ]


def test_settings_are_what_varies_but_the_seed_and_have_means_over_it() -> None:
    a, b = by_setting(rows(), LABELS, {"delivery_0_1"})
    assert (dict(a.labels), a.runs, a.passed) == ({"radio": "a"}, 3, 2)
    assert (dict(b.labels), b.runs, b.passed, b.failed) == ({"radio": "b"}, 4, 2, 1), "one was not flown"
    assert list(a.means) == ["far_m", "delivery"], (
        "the study's own first; ids, counts and links are not for people"
    )
    error = np.std(FAR_M["a"], ddof=1) / math.sqrt(3)
    assert (a.means["far_m"].value, a.means["far_m"].error) == (15.0, pytest.approx(error))
    assert b.means["far_m"] == Mean(5.0, 0.0, 2), "what is no number does not count"


def test_a_run_that_could_not_be_measured_counts_as_failed_and_not_as_passed() -> None:
    measured, other = rows()[0], {**rows()[0], "failure": "own.py:measure: ValueError: no"}
    (only,) = by_setting([measured, other], LABELS)
    assert (only.runs, only.passed, only.failed) == (2, 1, 1)


@pytest.mark.parametrize(
    ("mean", "text"),
    [
        (Mean(15.0, 3.2145, 3), "15.0 ± 3.2"),
        (Mean(0.98765, 0.00123, 9), "0.9877 ± 0.0012"),
        (Mean(1234.5, 99.6, 9), "1230 ± 100"),
        (Mean(123456.0, 9960.0, 9), "123000 ± 10000"),
        (Mean(5.0, 0.0996, 9), "5.00 ± 0.10"),
        (mean_of([0.1 + 0.2, 0.3, 0.3]), "0.3 ± 0"),
        (Mean(1.0, 0.0, 3), "1 ± 0"),
        (Mean(0.123456, math.nan, 1), "0.1235"),
        (Mean(math.nan, math.nan, 0), ""),
    ],
)
def test_a_mean_has_two_digits_of_its_error(mean: Mean, text: str) -> None:
    assert str(mean) == text


def test_a_study_of_one_run_has_one_setting_without_labels() -> None:
    (only,) = by_setting(rows()[:1], LABELS)
    assert (dict(only.labels), only.runs, str(only.means["far_m"])) == ({}, 1, "10")


def test_each_link_has_a_column_of_its_own_whatever_its_ends_are_called() -> None:
    nodes = ("a", "a_b", "b_c", "c", "0", "1")
    links = list(permutations(nodes, 2))
    radios = ("main", "a", "a_b", "c2")
    assert len({link_column(*link, radio) for link in links for radio in radios}) == len(links) * len(radios)
    assert link_column("0", "gcs", "c2") == "delivery_c2_0_gcs"
    assert link_column("0", "1") == "delivery_0_1"
