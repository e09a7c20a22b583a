"""What is written of a packet and what decides its fate are the same numbers."""

import math

import numpy as np
import pytest

from channel import presets
from channel.draws import Draws, Purpose
from channel.link.radio import Radio
from channel.link.tables.steps import STEPS_PER_DB, STEPS_PER_M, STEPS_PER_ONE, in_steps
from channel.medium.medium import Fate, Medium
from channel.medium.simulate import simulate
from tests.unit.channel.medium.one_by_one import transmitted


def radio(name, **overrides):
    return Radio(presets.load_radio(name, overrides))


def written(value, digits):
    """What somebody who reads the record gets."""
    return float(f"{value:.{digits}f}")


def receptions(model, distance_m, packets, nodes=3):
    names = [str(i) for i in range(nodes)]
    medium = Medium(model, seed=4, nodes=names)
    for i, name in enumerate(names):
        medium.place(name, (distance_m * i, 0.0, -40.0))
    return [each for seq in range(packets) for each in transmitted(medium, "0", seq, 50_000_000 * seq, 40)]


@pytest.mark.parametrize(("steps", "digits"), [(STEPS_PER_M, 3), (STEPS_PER_DB, 3), (STEPS_PER_ONE, 7)])
def test_steps_are_the_decimals_of_the_record(steps, digits):
    values = np.random.Generator(np.random.PCG64(1)).normal(0.0, 400.0, 5000)
    assert in_steps(values, steps).tolist() == [written(value, digits) for value in values]


def test_last_bits_do_not_show():
    values = np.random.Generator(np.random.PCG64(2)).normal(0.0, 60.0, 5000)
    above, below = np.nextafter(values, math.inf), np.nextafter(values, -math.inf)
    assert np.array_equal(in_steps(above, STEPS_PER_DB), in_steps(below, STEPS_PER_DB))
    zeros = in_steps(np.array([-1e-13, 0.0, 1e-13]), STEPS_PER_DB)
    assert [f"{zero:.3f}" for zero in zeros] == ["0.000"] * 3
    assert np.isnan(in_steps(np.array([math.nan]), STEPS_PER_M)).all()


@pytest.mark.parametrize("name", ["moon2020", "corrected", "wifi-2.4", "lte-like"])
def test_a_packet_has_the_error_rate_and_the_fate_of_its_written_snr(name):
    model = radio(name, bursts={"model": "none"}, base_loss=0.0, max_range_m=None)
    near = {"moon2020": 370.0, "corrected": 900.0, "wifi-2.4": 1200.0, "lte-like": 14000.0}[name]
    settled = receptions(model, near, 300)
    assert {each.fate for each in settled} == {Fate.DELIVERED, Fate.CHANNEL_ERASURE}
    for each in settled:
        if math.isnan(each.snr_db):  # nothing was drawn: the packet was lost whatever would have been
            assert (each.per, each.fate) == (1.0, Fate.CHANNEL_ERASURE)
            assert math.isnan(each.received_power_dbm)
            continue
        assert each.snr_db == written(each.snr_db, 3)
        assert each.received_power_dbm == written(each.received_power_dbm, 3)
        assert each.distance_m == written(each.distance_m, 3)
        assert each.per == written(model.per(each.snr_db, each.length_bytes), 7)
        draw = Draws(4).uniform(Purpose.ERASURE, each.tx, each.rx, each.seq)
        assert (each.fate is Fate.DELIVERED) == (draw > each.per)


@pytest.mark.parametrize(("distance_m", "arrives"), [(400.0004, True), (400.0006, False)])
def test_the_range_ends_at_the_written_distance(distance_m, arrives):
    disk = radio("disk")
    (got,) = (each for each in receptions(disk, distance_m, 1, nodes=2))
    assert got.fate is (Fate.DELIVERED if arrives else Fate.OUT_OF_RANGE)
    assert (got.per, got.probability_of_delivery) == ((0.0, 1.0) if arrives else (1.0, 0.0))
    assert bool(disk.link(distance_m).in_range) == arrives
    assert float(disk.probability_of_delivery(distance_m)) == arrives
    assert simulate(disk, Draws(1), [("a", "b")], distance_m, packets=1).delivered.tolist() == [[arrives]]
