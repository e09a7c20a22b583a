"""Frames that a network draws together have the fates, powers and verdict of frames that are drawn one by one."""

from collections.abc import Mapping, Sequence
from math import cos, pi, sin
from typing import Any

import numpy as np
import pytest

from channel.access.air import Hearing
from channel.access.media.csma import Csma
from channel.access.packets import PLAIN, AirFrame
from channel.access.timing import wifi_g
from channel.access.world import FrameArrivals, World
from channel.link.radio import Radio
from channel.medium.judge.judge import Judge
from channel.medium.medium import Medium
from channel.medium.reception import Receptions
from channel.network.entry import EntryInstants, EntrySettings
from channel.network.network import Lived, Network
from channel.presets import load_radio

TICK_NS = 50_000_000
NODES, TICKS = 14, 16
SLOTS = {
    "position_ned_m": [30, 10, -30],
    "power_dbm": -20,
    "bandwidth_hz": 2e7,
    "duty": 0.5,
    "slot_s": 0.0004,
}
RADIOS: Mapping[str, Sequence[Mapping[str, Any]]] = {
    "wifi": [{}],
    "redrawn": [
        {
            "fading": {"model": "rayleigh", "coherence": "packet"},
            "shadowing": {"model": "normal", "sigma_db": 6.0},
        }
    ],
    "blocks": [{"fading": {"model": "rayleigh", "coherence": "block", "max_coherence_s": 1.0}}],
    "jammed in slots": [{"interference": {"interferers": [SLOTS]}}],
    "several": [{}, {"transmit_power_dbm": 5.0, "antenna": {"model": "isotropic", "gain_db": 2.0}}],
}


class Blind:
    """A world that foresees nothing."""

    def __init__(self, world: World) -> None:
        self.nodes, self.reach, self.survives = world.nodes, world.reach, world.survives
        self.comes_alone = world.comes_alone


class Counting:
    """A world that counts what it was told to expect."""

    def __init__(self, world: Any) -> None:
        self.nodes, self.ids = world.nodes, world.ids
        self.survives, self.comes_alone = world.survives, world.comes_alone
        self.forget, self.delays_ns = world.forget, world.delays_ns
        self._world, self._expected = world, set[tuple[int, int, int]]()
        self.expected = self.started = 0

    def expect(self, frames: Sequence[AirFrame]) -> None:
        self._expected |= {(each.node, each.number, each.started_ns) for each in frames}
        self._world.expect(frames)

    def reach(self, frame: AirFrame) -> FrameArrivals:
        self.started += 1
        self.expected += (frame.node, frame.number, frame.started_ns) in self._expected
        return self._world.reach(frame)  # type: ignore[no-any-return]


class Flight:
    """Nodes on a ring that drift and send ten packets a second; what came of them."""

    def __init__(self, radios: str, world_of: Any, ring_m: float) -> None:
        names = [str(node) for node in range(NODES)]
        kinds = [Radio(load_radio("wifi-2.4", each)) for each in RADIOS[radios]]
        by_node = {name: kinds[node % len(kinds)] for node, name in enumerate(names)}
        medium = Medium(by_node, seed=3, nodes=names, ahead_ns=2 * TICK_NS)
        entry = EntryInstants(names, EntrySettings(None, 0.001, 0.001), TICK_NS, medium.draws)
        self.judge, self.worlds = Judge(NODES), list[Any]()
        network = Network(medium, lambda world: self._open(world_of(world)), entry, self.judge)
        turn = 2.0 * pi / NODES
        places = np.array([(ring_m * cos(turn * n), ring_m * sin(turn * n), -40.0) for n in range(NODES)])
        self.lived: list[Lived] = []
        self.judge_of_singles = Judge(NODES)
        singles = medium.drawing(judge=self.judge_of_singles)
        for tick in range(TICKS):
            medium.observe(names, tick * TICK_NS, places + 0.3 * tick)
            if tick == 9:
                medium.switch_radio("4", tick * TICK_NS + TICK_NS // 3, on=False)
            if tick % 2 == 0:
                seq = np.full(NODES, tick // 2)
                packets = medium.packets(tx=names, seq=seq, sim_time_ns=tick * TICK_NS, length_bytes=100)
                network.send(packets, [PLAIN] * packets.size)
            self.lived.append(network.live((tick + 1) * TICK_NS))
            for first in self.lived[-1].first:
                singles.receptions(first.packets, first.packets.length_bytes)
        self.lived.append(network.end())

    def _open(self, world: Any) -> Csma:
        self.worlds.append(world)
        return Csma(world, wifi_g(), hearing=Hearing(10**-9.5, 10**-6.2, cca_ns=4_000))

    def columns(self) -> list[np.ndarray[Any, Any]]:
        """Everything, in order."""
        parts: list[np.ndarray[Any, Any]] = []
        for lived in self.lived:
            at = lived.instants
            parts += [*_columns(lived.receptions), at.entered_ns, at.started_ns, at.ended_ns, at.arrived_ns]
            parts += [at.attempts, np.array(lived.done, dtype=np.int64)]
            if lived.first:
                parts += _columns(Receptions.joined(lived.first))
        return parts


def _columns(r: Receptions) -> list[np.ndarray[Any, Any]]:
    drawn = [r.distance_m, r.received_power_dbm, r.snr_db, r.per, r.probability_of_delivery, r.fate]
    return [*r.packets, r.packet, r.rx, *drawn]


@pytest.mark.slow
@pytest.mark.parametrize("ring_m", [100.0, pytest.param(1500.0, marks=pytest.mark.slow)])
@pytest.mark.parametrize("radios", RADIOS)
def test_together_or_one_by_one(radios: str, ring_m: float) -> None:
    """Bit for bit: all columns of all receptions, and the verdict."""
    together, singly = Flight(radios, Counting, ring_m), Flight(radios, Blind, ring_m)
    for found, wanted in zip(together.columns(), singly.columns(), strict=True):
        assert found.dtype == wanted.dtype
        assert found.tobytes() == wanted.tobytes()
    for judge in (together.judge, singly.judge, singly.judge_of_singles):
        assert repr(judge.verdict()) == repr(together.judge_of_singles.verdict())
    assert sum(lived.receptions.size for lived in together.lived) == TICKS // 2 * NODES * (NODES - 1)


def test_most_frames_are_foreseen() -> None:
    """Else it would be in vain."""
    [world] = Flight("wifi", Counting, 100.0).worlds
    assert world.started == TICKS // 2 * NODES
    assert world.expected > 0.9 * world.started
