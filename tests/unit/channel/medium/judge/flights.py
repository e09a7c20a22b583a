"""Simulated flights for the verdict: aircraft that fly from place to place, judged by their own radio or another."""

import numpy as np

from channel.link.decision import signal_of
from channel.link.tables.lengths import Lengths
from channel.medium.judge.judge import Judge
from channel.medium.medium import Medium

NODES = 5
STEP_NS = 500_000_000
SPEED_MPS = 20.0
STEPS_AT_ONCE = 200
LENGTH_BYTES = 40


def reach_m(radio):
    """How far a radio delivers a packet in fifty."""
    grid = np.geomspace(1.0, 60_000.0, 400)
    p = radio.probability_of_delivery(
        ground_distance_m=grid, height_tx_m=40.0, height_rx_m=40.0, length_bytes=LENGTH_BYTES
    )
    return float(grid[p > 0.02 * p[0]][-1])


def tracks_m(seed, reach, steps):
    """Positions of all nodes, shape (steps, nodes, 3): to and fro in a square of 1.2 times the reach."""
    rng = np.random.Generator(np.random.PCG64(seed))
    step_m = SPEED_MPS * STEP_NS * 1e-9
    out = np.empty((steps, NODES, 3))
    for node in range(NODES):
        here, goal = rng.uniform(-0.6, 0.6, (2, 2)) * reach
        for step in range(steps):
            way = goal - here
            left_m = float(np.hypot(*way))
            if left_m < step_m:
                goal = rng.uniform(-0.6, 0.6, 2) * reach
            else:
                here = here + way * (step_m / left_m)
            out[step, node] = (*here, -40.0 - 5.0 * node)
    return out


class Other(Judge):
    """Judges by another radio than the one that drew: what it has for mean power, noise and error rate."""

    def __init__(self, radio):
        super().__init__(NODES)
        self._other = radio

    def take(self, drawn, links, mean_power_dbm, noise_dbm, signal, erased):
        del drawn, mean_power_dbm, noise_dbm
        radio, path = self._other, links.path
        noise_dbm = radio.noise_dbm(path)
        lengths = Lengths.same(radio.length_bytes(LENGTH_BYTES))
        per = signal_of(radio, links.distance_m, signal.received_power_dbm, noise_dbm, lengths).per
        super().take(radio, links, radio.mean_power_dbm(path), noise_dbm, signal._replace(per=per), erased)

    def take_base_losses(self, drawn, lost):
        del drawn
        super().take_base_losses(self._other, lost)


def verdict_of(drawn, judge, seed, receptions, reach):
    """The verdict on a flight of so many receptions, drawn by a radio."""
    steps = receptions // (NODES * (NODES - 1))
    medium = Medium(drawn, seed=seed, nodes=[f"n{i}" for i in range(NODES)], judge=judge)
    places, nodes = tracks_m(seed, reach, steps), np.arange(NODES)
    for step in range(steps):
        medium.observe(nodes, step * STEP_NS, places[step])
        medium.send(
            medium.packets(tx=medium.nodes, seq=step, sim_time_ns=step * STEP_NS, length_bytes=LENGTH_BYTES)
        )
        if step % STEPS_AT_ONCE == STEPS_AT_ONCE - 1:
            medium.settle()
    medium.flush()
    return judge.verdict()
