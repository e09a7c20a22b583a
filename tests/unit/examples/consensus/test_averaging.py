"""Nothing of the average is lost, whatever packets are: in exact fractions, for any pattern of losses."""

from __future__ import annotations

from fractions import Fraction
from itertools import permutations

import numpy as np
import pytest
from averaging import Averaging, Naive, RunningSums
from hypothesis import given
from hypothesis import strategies as st

UA = ("0", "1", "2", "3")
LINKS = tuple(permutations(UA, 2))
values = st.lists(st.fractions(-100, 100, max_denominator=50), min_size=len(UA), max_size=len(UA))
rounds = st.lists(st.lists(st.booleans(), min_size=len(LINKS), max_size=len(LINKS)), max_size=8)


def running_sums(begin: list[Fraction]) -> dict[str, RunningSums]:
    """A fleet; the number of shares is a fraction, too, so that weights are."""
    return {node: RunningSums([value], Fraction(len(UA))) for node, value in zip(UA, begin, strict=True)}


def all_step(fleet: dict[str, Averaging], number: int, arrived: list[bool]) -> None:
    """One round: all step, then what is broadcast arrives, or not."""
    told = {node: each.step() for node, each in fleet.items()}
    for (sender, receiver), arrives in zip(LINKS, arrived, strict=True):
        if arrives:
            fleet[receiver].hear(sender, number, told[sender])


def on_its_way(fleet: dict[str, RunningSums], axis: int) -> Fraction:
    """What was given and has not been heard yet."""
    return sum(
        fleet[sender].sums[axis]
        - (fleet[receiver].heard[sender][1][axis] if sender in fleet[receiver].heard else 0)
        for sender, receiver in LINKS
    )


@given(values, rounds)
def test_mass_and_weight_stay_exactly_the_same_for_any_losses(
    begin: list[Fraction], losses: list[list[bool]]
) -> None:
    fleet = running_sums(begin)
    for number, arrived in enumerate(losses):
        all_step(fleet, number, arrived)
        assert sum(each.mass[0] for each in fleet.values()) + on_its_way(fleet, 0) == sum(begin)
        assert sum(each.mass[1] for each in fleet.values()) + on_its_way(fleet, 1) == len(UA)
        assert all(each.mass[1] > 0 for each in fleet.values())


@given(values, rounds)
def test_estimates_stay_between_the_least_and_the_greatest_value(
    begin: list[Fraction], losses: list[list[bool]]
) -> None:
    fleet = running_sums(begin)
    for number, arrived in enumerate(losses):
        all_step(fleet, number, arrived)
    assert all(min(begin) <= each.estimate[0] <= max(begin) for each in fleet.values())


@given(st.permutations(range(5)))
def test_what_comes_late_or_again_changes_nothing(order: list[int]) -> None:
    """Broadcasts in any order leave what the newest alone would."""
    sender = RunningSums([Fraction(7)], Fraction(2))
    broadcasts = [sender.step() for _ in range(5)]
    receiver, expected = (RunningSums([Fraction(1)], Fraction(2)) for _ in range(2))
    for number in (*order, *order):
        receiver.hear("0", number, broadcasts[number])
    expected.hear("0", 4, broadcasts[4])
    assert receiver.mass == expected.mass


@pytest.mark.parametrize("seed", range(5))
def test_they_find_the_average_with_half_of_all_packets_lost_one_link_more_than_others(seed: int) -> None:
    rng = np.random.default_rng(seed)
    begin = rng.uniform(-300.0, 300.0, (len(UA), 2))
    fleet = {node: RunningSums(place.tolist(), len(UA)) for node, place in zip(UA, begin, strict=True)}
    arrives = np.where(np.arange(len(LINKS)) == 3, 0.1, 0.5)
    for number in range(150):
        all_step(fleet, number, (rng.random(len(LINKS)) < arrives).tolist())
    for each in fleet.values():
        assert each.estimate == pytest.approx(begin.mean(axis=0), abs=1e-3)


def test_naive_averaging_keeps_the_average_if_every_packet_arrives_and_moves_it_if_one_does_not() -> None:
    begin = [Fraction(0), Fraction(0), Fraction(0), Fraction(8)]

    def after(arrived: list[bool]) -> list[Fraction]:
        fleet = {node: Naive([value], len(UA)) for node, value in zip(UA, begin, strict=True)}
        for number in range(2):  # what arrives in a round counts at the next step
            all_step(fleet, number, arrived)
        return [each.estimate[0] for each in fleet.values()]

    assert after([True] * len(LINKS)) == [2, 2, 2, 2]
    assert after([link != ("3", "0") for link in LINKS]) == [0, 2, 2, 2]  # UA 0 has not heard of the 8
