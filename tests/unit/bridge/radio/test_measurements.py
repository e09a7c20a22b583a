"""Sensors at the router: measured from the true places, told as they identify, for the nodes that have them."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from bridge.agents.measurements import Measurement
from bridge.bus.messages import Header, Heard, Quaternion, Truth, Vector3, decode, encode
from bridge.host.arrivals import hand_out
from bridge.radio.heard import Hosts
from bridge.radio.measurements import RfSensors, Told, as_message
from bridge.radio.network_air import NetworkAir
from bridge.radio.radio import SettledTick
from bridge.radio.ring import Ring
from bridge.radio.senders import Refused
from bridge.radio.virtual_radio import VirtualRadio
from bridge.record.tables.every import finish_tables
from bridge.record.tables.measurements import MEASUREMENTS, MeasurementWriter
from bridge.record.tables.reader import read_columns
from channel.link.emitters.emitter import Emitter
from channel.link.radio import Radio
from channel.medium.medium import Medium
from channel.presets import load_radio
from channel.sensing.sensing import Sensing
from channel.sensing.sensor import SensorConfig

NODES = ("0", "gcs", "1")
TICK_NS = 50_000_000
RECEIVER = load_radio("rf-sensor", {"fading": {"model": "none"}, "shadowing": {"model": "none"}})
EMITTERS = (
    Emitter(name="c", frequency_hz=433.90e6, power_dbm=10.0),
    Emitter(name="a", frequency_hz=433.95e6, power_dbm=20.0),
    Emitter(name="b", frequency_hz=433.90e6, power_dbm=30.0),
)
POWERS_DBM = (-59.0, -49.0, -39.0)
"""At 100 m in steps of 1 dB: 20 log10(4 pi f / c) is 25.2 dB, and 22 log10(100) is 44."""


class Bench:
    """A medium, a virtual radio and sensors: nodes 0 and 1 have one."""

    def __init__(self, tells: str) -> None:
        names = [each.name for each in EMITTERS]
        self.medium = Medium(Radio(load_radio("perfect")), seed=1, nodes=NODES, emitters=names)
        self.core = VirtualRadio([NetworkAir(self.medium)], Ring(NODES, tick_period_ns=TICK_NS))
        config = SensorConfig(radio=RECEIVER, rate_hz=10.0, step_db=1.0, identifies=tells)
        sensing = Sensing({"1": config, "0": config}, EMITTERS, seed=1)
        self.sensors = RfSensors(sensing, (tells, tells), self.medium)

    def tick(self, number: int) -> None:
        """Truth: all sensors are 100 m from all emitters, node gcs elsewhere."""
        places = {"0": (0.0, 0.0), "1": (0.0, 0.0), "gcs": (9.0, 9.0)} | {
            each.name: (100.0, 0.0) for each in EMITTERS
        }
        self.core.on_truths(
            Truth(
                Header.at(number * TICK_NS, name),
                position_ned_m=Vector3(*place, -40.0),
                attitude=Quaternion(),
            )
            for name, place in places.items()
        )

    def told(self, number: int) -> list[Told]:
        self.tick(number)
        return self.sensors.told(self.sensors.measure(number * TICK_NS))


@pytest.mark.parametrize(
    ("tells", "emitters", "frequencies_mhz", "order"),
    [
        ("id", ("a", "b", "c"), (433.95, 433.90, 433.90), (1, 2, 0)),
        ("frequency", ("", "", ""), (433.90, 433.90, 433.95), (0, 2, 1)),
        ("none", ("", "", ""), (math.nan,) * 3, (0, 1, 2)),
    ],
)
def test_a_sensor_tells_what_it_identifies_and_its_order_no_more(
    tells: str, emitters: tuple[str, ...], frequencies_mhz: tuple[float, ...], order: tuple[int, ...]
) -> None:
    told = Bench(tells).told(0)
    assert [each.node for each in told] == [0, 0, 0, 2, 2, 2]
    assert tuple(each.emitter for each in told[:3]) == emitters
    assert tuple(each.power_dbm for each in told[3:]) == tuple(POWERS_DBM[i] for i in order)
    message = as_message(0, told)
    assert np.array(message.frequency_hz[:3]) / 1e6 == pytest.approx(frequencies_mhz, nan_ok=True)


def test_measurements_come_to_the_nodes_that_took_them_when_they_are_due() -> None:
    bench = Bench("id")
    assert len(bench.told(0)) == 6
    assert bench.told(1) == []
    told = bench.told(2)
    hosts = Hosts(NODES, {"host-0": ("0", "gcs"), "host-1": ("1",)})
    shares = hosts.shares(SettledTick(2 * TICK_NS, bench.core.settle(), [], told))
    got: dict[str, list[Measurement]] = {}

    class Ear:
        def __init__(self, node: str) -> None:
            self.node = node

        def measurements_came(self, measurements: list[Measurement]) -> None:
            got[self.node] = measurements

    for host, nodes in (("host-0", ("0", "gcs")), ("host-1", ("1",))):
        heard = decode(encode(shares[host]), Heard)
        hand_out(heard, NODES, {node: Ear(node) for node in nodes})
    assert list(got) == ["0", "1"]
    assert got["0"] == [
        Measurement(2 * TICK_NS, 1, power, frequency, name)
        for name, frequency, power in (("a", 433.95e6, -49.0), ("b", 433.9e6, -39.0), ("c", 433.9e6, -59.0))
    ]


def test_truth_of_emitters_is_taken_and_of_strangers_is_not() -> None:
    bench = Bench("id")
    bench.tick(0)
    assert not bench.core.refused
    bench.core.on_truths([Truth(Header.at(0, "stranger"), attitude=Quaternion())])
    assert bench.core.refused[Refused.UNKNOWN_NODE] == 1
    bench.core.on_truths([Truth(Header.at(0, "a"), position_ned_m=Vector3(math.nan, 0.0, 0.0))])
    assert bench.core.refused[Refused.MALFORMED] == 1


def test_the_record_has_the_terms_that_agents_do_not_see(tmp_path: Path) -> None:
    bench = Bench("none")
    bench.tick(0)
    columns = MeasurementWriter(tmp_path, ("1", "0"), [each.name for each in EMITTERS])
    columns.write(0, bench.sensors.measure(0))
    columns.close()
    finish_tables(tmp_path)
    batch = read_columns(tmp_path, MEASUREMENTS)
    assert batch["node"].tolist() == ["1"] * 3 + ["0"] * 3
    assert batch["emitter"].tolist() == ["c", "a", "b"] * 2
    assert batch["power_dbm"].tolist() == [*POWERS_DBM] * 2
    assert batch["distance_m"].tolist() == [100.0] * 6
    assert set(batch["outcome"].tolist()) == {"measured"}
