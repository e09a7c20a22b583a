"""What an agent gets of its sensor: new measurements, the latest, its own state at that time, and the data package."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from bridge.agents.agent import Agent
from bridge.agents.client import UaClient
from bridge.agents.measurements import Measurement, SensorMemory
from bridge.bus.messages import AircraftState, DataPackage, Header, decode, encode
from bridge.scenario.sections import Transmit
from channel.presets import load_radio
from channel.sensing.sensor import Sensor, SensorConfig
from tests.unit.bridge.agents.running.test_runner import AIRCRAFT, TICK_NS, Heard

SENSOR = Sensor(SensorConfig(radio=load_radio("rf-sensor")))


def at(tick: int, power_dbm: float, **whose: object) -> Measurement:
    return Measurement(tick * TICK_NS, tick, power_dbm, **whose)  # type: ignore[arg-type]


def powers(measured: SensorMemory) -> tuple[list[float], list[float]]:
    return [each.power_dbm for each in measured], [each.power_dbm for each in measured.latest]


def test_new_ones_go_with_the_tick_and_the_latest_stay() -> None:
    measured = SensorMemory()
    measured.take([at(0, -50.0, emitter="b"), at(0, -60.0, emitter="a")])
    assert powers(measured) == ([-50.0, -60.0], [-60.0, -50.0])
    measured.take([])
    assert powers(measured) == ([], [-60.0, -50.0])
    measured.take([at(2, -55.0, emitter="b")])
    assert powers(measured) == ([-55.0], [-60.0, -55.0])
    assert len(measured) == 1


def test_what_is_not_told_apart_is_replaced_together() -> None:
    by_frequency, blind = SensorMemory(), SensorMemory()
    by_frequency.take([at(0, -70.0, frequency_hz=9e8), at(0, -50.0, frequency_hz=1e9)])
    by_frequency.take([at(1, -51.0, frequency_hz=1e9), at(1, -52.0, frequency_hz=1e9)])
    assert powers(by_frequency)[1] == [-70.0, -51.0, -52.0]
    blind.take([at(0, -70.0), at(0, -50.0)])
    blind.take([at(1, -71.0)])
    assert powers(blind)[1] == [-71.0]


class Keeper(Agent):
    """Keeps what it was told."""

    def __init__(self, *args: object) -> None:
        super().__init__(*args)  # type: ignore[arg-type]
        self.seen: list[Measurement] = []

    def on_measurement(self, measurement: Measurement) -> None:
        self.seen.append(measurement)


def lived(ticks: dict[int, list[Measurement]], last: int, every_ticks: int = 1) -> tuple[Keeper, Heard]:
    """An agent that gets its state at each tick, and measurements of the tick before."""
    outlet = Heard()
    ua = UaClient("1", outlet, sensor=SENSOR)
    agent = Keeper(ua, AIRCRAFT, Transmit(every_ticks=every_ticks))
    for tick in range(last + 1):
        ua.take_clock(tick * TICK_NS)
        ua.take_state(AircraftState(Header.at(tick * TICK_NS, "1"), altitude_rel_m=float(tick)))
        ua.take_measurements(ticks.get(tick, []))
        agent.transmit_package(tick * TICK_NS)
    return agent, outlet


def test_a_measurement_has_the_nodes_own_state_of_its_tick() -> None:
    agent, _ = lived({3: [at(2, -50.0)], 5: [at(4, -51.0)]}, last=6)
    assert [(each.number, each.state and each.state.altitude_rel_m) for each in agent.seen] == [
        (2, 2.0),
        (4, 4.0),
    ]


def test_each_measurement_is_in_one_data_package() -> None:
    _, outlet = lived(
        {1: [at(0, -50.0), at(0, -60.0)], 2: [at(1, -51.0)], 4: [at(3, -52.0)]}, last=6, every_ticks=3
    )
    packages = [decode(payload, DataPackage).received_power_dbm for _, payload, _ in outlet.sent]
    assert packages == [(), (-50.0, -60.0, -51.0), (-52.0,)]


@pytest.mark.parametrize("said", [(-1.0, 0.0), [-1.0, 0.0], np.array([-1.0, 0.0])])
def test_an_agent_may_say_itself_what_it_measured(said: Sequence[float]) -> None:
    agent, _ = lived({1: [at(0, -50.0)]}, last=0)
    agent.measurements_dbm = said
    assert decode(encode(agent.package(0)), DataPackage).received_power_dbm == (-1.0, 0.0)
