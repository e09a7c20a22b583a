"""Packets of a mesh follow each other in tens of milliseconds: how shadowing changes over centimetres is not judged."""

import numpy as np
import pytest

from channel import presets
from channel.link.radio import Radio
from channel.medium.judge.changes import FROM_PACKET_TO_PACKET
from channel.medium.judge.judge import Judge
from channel.medium.medium import Medium

NODES = 3
PERIOD_NS, GAP_NS = 2_500_000_000, 40_000_000
SPEED_MPS = np.array([0.0, 0.0, -2.5])  # a climb
HOME_M = np.array([[0.0, 0.0, -5.0], [180.0, 0.0, -5.0], [360.0, 0.0, -10.0]])


def checks(seed):
    radio = Radio(presets.load_radio("wifi-2.4"))
    judge = Judge(NODES, seed)
    medium = Medium(radio, seed=seed, nodes=[f"n{i}" for i in range(NODES)], judge=judge)
    for pair in range(16):
        for second in range(2):
            now_ns = pair * PERIOD_NS + second * GAP_NS
            medium.observe(np.arange(NODES), now_ns, HOME_M + SPEED_MPS * (now_ns * 1e-9))
            medium.send(
                medium.packets(tx=medium.nodes, seq=2 * pair + second, sim_time_ns=now_ns, length_bytes=40)
            )
            medium.settle()
    medium.flush()
    verdict = judge.verdict()
    return {each.name: each for each in (*verdict.checks, *verdict.unjudged)}[FROM_PACKET_TO_PACKET.name]


@pytest.mark.slow
def test_a_right_run_is_not_called_wrong():
    alarms = [seed for seed in range(12) if not getattr(checks(seed), "passed", True)]
    assert not alarms


def test_pairs_that_turn_on_such_steps_are_left_out():
    assert checks(1).why == "0 of 8 pairs of packets"
