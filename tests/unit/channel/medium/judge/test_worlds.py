"""The verdict on powers that the channel did not draw, ten times each; a hundred in test_channel_verdict.py."""

from dataclasses import replace

import numpy as np
import pytest

from channel.medium.judge.changes import OVER_PLACE
from tests.unit.channel.medium.judge.worlds import (
    FLIGHT,
    PACKETS,
    RIGHT,
    WRONG,
    chances,
    failures,
    radio_of,
    verdicts,
)

REPEATS = 10
OFTEN_ENOUGH = 9
SHORT = {"pairs": 2, "packets": 400}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["steps of the line of sight", "one-sided and rounded"])
def test_steps_and_rounding_raise_no_alarm(name):
    radio, changes, world = RIGHT[name]
    judged = verdicts((radio, changes, replace(world, **SHORT)), REPEATS)
    assert not failures(judged)
    assert {check.name for check in judged[0].checks} >= {"level of the powers", "spread of the powers"}


@pytest.mark.slow
def test_changes_that_swing_together_raise_no_alarm():
    """One of these worlds had a chance of 0.00003, and 13 of less than 0.1, when all pairs counted as independent."""
    judged = verdicts(RIGHT["Rician fading of many ends that hover"], 60)
    assert not failures(judged)
    found = chances(judged)[PACKETS]
    assert len(found) == 60
    assert sum(chance < 0.1 for chance in found) <= 10
    assert sum(chance > 0.5 for chance in found) >= 15  # nor is everything let through


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        pytest.param("decorrelation times four", marks=pytest.mark.slow),
        "Rayleigh fading redrawn in a hover",
    ],
)
def test_wrong_correlation_is_seen(name):
    radio, changes, world, _ = WRONG[name]
    failed = failures(verdicts((radio, changes, replace(world, packets=1000)), REPEATS))
    assert (
        sum(WRONG[name][3] in [check.name for check in checks] for checks in failed.values()) >= OFTEN_ENOUGH
    )


def test_ends_that_move_next_to_nothing_are_seen_as_those_that_hover():
    """Of shadowing nothing changes there; a slope over such a way, taken for real, left a power of 0.2."""
    radio, changes, world = RIGHT["fading of ends that hover"]
    judged = replace(world, speed_mps=1e-9, packets=1500).verdict(radio_of(radio, changes), 0)
    found = {check.name: check for check in judged.checks}[PACKETS]
    assert found.power > 0.9
    assert found.chance > 0.1


def test_a_short_flight_says_that_it_sees_nothing_of_correlation():
    radio = radio_of("wifi-2.4", {})
    judged = replace(FLIGHT, pairs=1, packets=100).verdict(radio, 1)
    over = {check.name: check for check in judged.checks}[OVER_PLACE.name]
    assert not over.sees
    assert over.power < 0.2
    shorter = replace(FLIGHT, pairs=1, packets=30).verdict(radio, 1)
    assert [each.why for each in shorter.unjudged if each.name == OVER_PLACE.name] == [
        "6 of 8 pairs of packets"
    ]


@pytest.mark.slow
def test_power_is_the_share_of_wrong_worlds_that_are_seen():
    """With so few places that about half are."""
    radio, changes, world, name = WRONG["2 dB less than one-sided"]
    few = replace(world, pairs=1, packets=170)
    judged = verdicts((radio, changes, replace(few, off_db=0.0)), REPEATS)
    power = np.mean([check.power for verdict in judged for check in verdict.checks if check.name == name])
    failed = failures(verdicts((radio, changes, few), 40)).values()
    seen = sum(name in [check.name for check in checks] for checks in failed) / 40
    assert abs(seen - power) < 3.5 * np.sqrt(power * (1.0 - power) / 40)
