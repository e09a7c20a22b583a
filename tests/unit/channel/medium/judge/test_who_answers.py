"""Where one node only answers another, packets of its own are on the air at good places alone."""

import numpy as np
import pytest

from channel import presets
from channel.link.radio import Radio
from channel.medium.judge.judge import Judge
from channel.medium.medium import Medium
from channel.medium.reception import FATES, Fate

STEP_NS = 1_000_000_000
RADIUS_M, STEPS, ROUNDS = 420.0, 250, 4
DELIVERED = FATES.index(Fate.DELIVERED)


def around_m(step):
    """On circles one above the other, farther apart than shadowing lasts."""
    turn = 2.0 * np.pi * step / STEPS
    return (RADIUS_M * np.cos(turn), RADIUS_M * np.sin(turn), -40.0 - 60.0 * (step // STEPS))


def verdict(*, asks, answers):
    """Of a flight in which one node calls at each step, and the other one answers when it heard it."""
    radio = Radio(presets.load_radio("hata-qpsk"))
    judge = Judge(2, 3)
    medium = Medium(radio, seed=3, nodes=("0", "1"), judge=judge)
    places = {asks: around_m, answers: lambda _step: (0.0, 0.0, -40.0)}
    shares = []
    for step in range(STEPS * ROUNDS):
        now_ns = step * STEP_NS
        for node, place in places.items():
            medium.observe(node, now_ns, place(step))
        senders = [asks, answers] if shares and shares[-1] else [asks]
        for node in senders:
            medium.send(medium.packets(tx=node, seq=step, sim_time_ns=now_ns, length_bytes=40))
        found = medium.settle()
        shares.append(bool((found.fate[found.tx == medium.nodes.index(asks)] == DELIVERED).any()))
    assert 0.2 < np.mean(shares) < 0.8
    return judge.verdict()


@pytest.mark.parametrize(("asks", "answers"), [("0", "1"), ("1", "0")])
def test_answers_are_not_taken_for_powers_that_are_wrong(asks, answers):
    found = verdict(asks=asks, answers=answers)
    checks = {each.name: each for each in found.checks}
    assert checks["level of the powers"].size > 100
    assert checks["level of the powers"].power > 0.9
    assert found.passed, found.checks
