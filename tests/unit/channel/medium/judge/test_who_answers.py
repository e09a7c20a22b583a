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


def verdict(*, asks, answers, own_power_db, at_once):
    """Of a flight in which one node calls at each step, and the other one answers when it heard it.

    What was sent is judged by so many steps at once, as when a run is decided again.
    """
    radio = Radio(presets.load_radio("hata-qpsk"))
    power_dbm = radio.config.transmit_power_dbm + own_power_db
    radios = {"0": radio, "1": Radio(presets.load_radio("hata-qpsk", {"transmit_power_dbm": power_dbm}))}
    judge = Judge(2, 3)
    flown = Medium(radios, seed=3, nodes=("0", "1"))
    judged = Medium(radios, seed=3, nodes=("0", "1"), judge=judge)
    places = {asks: around_m, answers: lambda _step: (0.0, 0.0, -40.0)}
    shares = []
    for step in range(STEPS * ROUNDS):
        now_ns = step * STEP_NS
        senders = [asks, answers] if shares and shares[-1] else [asks]
        for medium in (flown, judged):
            for node, place in places.items():
                medium.observe(node, now_ns, place(step))
            for node in senders:
                medium.send(medium.packets(tx=node, seq=step, sim_time_ns=now_ns, length_bytes=40))
        found = flown.settle()
        shares.append(bool((found.fate[found.tx == flown.nodes.index(asks)] == DELIVERED).any()))
        if step % at_once == at_once - 1:
            judged.settle()
    assert 0.2 < np.mean(shares) < 0.8
    return judge.verdict()


@pytest.mark.parametrize(
    ("asks", "answers", "own_power_db", "at_once"),
    [
        pytest.param("0", "1", 0.0, 1, id="the first", marks=pytest.mark.slow),
        pytest.param("1", "0", 0.0, 1, id="the second"),
        pytest.param("1", "0", 0.01, 50, id="radios of their own", marks=pytest.mark.slow),
    ],
)
def test_answers_are_not_taken_for_powers_that_are_wrong(asks, answers, own_power_db, at_once):
    found = verdict(asks=asks, answers=answers, own_power_db=own_power_db, at_once=at_once)
    checks = {each.name: each for each in found.checks}
    assert checks["level of the powers"].size > 100
    assert checks["level of the powers"].power > 0.9
    assert found.passed, found.checks
