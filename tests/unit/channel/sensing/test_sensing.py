"""What sensors measure: of whom, when, by which law, and that nobody else matters."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import special, stats

from channel.checks import ChannelInputError
from channel.link.emitters.emitter import Emitter
from channel.link.radio import Radio
from channel.sensing.measured import OUTCOMES, Measured, Places, SensingOutcome
from channel.sensing.sensing import Sensing
from channel.sensing.sensor import Sensor
from tests.unit.channel.sensing.scenes import (
    CARRIER_HZ,
    PLAIN,
    TICK_NS,
    config,
    emitter,
    law_dbm,
    measured,
    told,
)

HERE = np.array([0.0, 0.0, -40.0])


def outcomes(found: Measured) -> list[str]:
    return [OUTCOMES[index].value for index in found.outcome]


@pytest.mark.parametrize(
    "radio",
    [
        {},
        {"shadowing": {"model": "gudmundson", "sigma_db": 4.0, "decorrelation_m": 20.0, "shared_ends": 0.5}},
        {"shadowing": {"model": "normal", "sigma_db": 4.0}, "fading": {"model": "rician", "k_db": 6.0}},
        {"propagation": {"model": "uma-av"}, "fading": {"model": "rayleigh", "coherence": "block"}},
    ],
)
def test_who_else_is_there_and_in_which_order_changes_no_measurement(radio: dict[str, object]) -> None:
    random = np.random.default_rng(3)
    names = ["b", "a", "d", "c"]
    ways = {
        name: random.uniform(-800.0, 800.0, (40, 3)) * [1, 1, 0] + [0, 0, -35.0] for name in (*names, *"012")
    }
    emitters = [emitter(name, duty=0.6 if name == "c" else 1.0) for name in names]
    few = told(measured({"1": config(radio)}, emitters[2:3], ways, ticks=40), ["1"], emitters[2:3])
    sensors = {"2": config(radio), "1": config(radio), "0": config(radio, rate_hz=7.0)}
    many = told(measured(sensors, emitters, ways, ticks=40), list(sensors), emitters)
    turned = dict(reversed(sensors.items()))
    back = told(measured(turned, emitters[::-1], ways, ticks=40), list(turned), emitters[::-1])
    assert len(few) == 40
    assert len(many) == 40 * 4 * 2 + 14 * 4
    assert str(sorted(many.items())) == str(sorted(back.items()))
    assert str(sorted(few.items())) == str(sorted((k, v) for k, v in many.items() if k in few))


def test_another_seed_draws_anew_and_the_same_one_the_same() -> None:
    ways = {"0": HERE, "beacon": np.array([200.0, 0.0, -2.0])}
    one, same, other = (
        measured({"0": config()}, [emitter()], ways, seed=seed, ticks=5) for seed in (1, 1, 2)
    )
    assert one.reading_dbm.tolist() == same.reading_dbm.tolist()
    assert not np.isin(one.reading_dbm, other.reading_dbm).any()


@pytest.mark.parametrize(
    ("rate_hz", "numbers"),
    [
        (20.0, [0, 1, 2, 3, 4, 5, 6, 7]),
        (10.0, [0, 1, 2, 3]),
        (6.0, [0, 1, 2]),  # at 0, 0.2 and 0.35 s, the first ticks not before sixths of a second
        (100.0, [0, 5, 10, 15, 20, 25, 30, 35]),
        (1.0, [0]),
    ],
)
def test_measurements_come_at_their_rate(rate_hz: float, numbers: list[int]) -> None:
    ways = {"0": HERE, "beacon": np.array([200.0, 0.0, -2.0])}
    found = measured({"0": config(rate_hz=rate_hz)}, [emitter()], ways, ticks=8)
    assert found.number.tolist() == numbers


@pytest.mark.parametrize("rate_hz", [3.0, 6.0, 7.0, 15.0, 19.0])
def test_a_measurement_that_is_due_at_a_tick_is_taken_then(rate_hz: float) -> None:
    """Number n at the first tick from n / rate on, in whole numbers, however the period rounds in nanoseconds."""
    ways = {"0": HERE, "beacon": np.array([200.0, 0.0, -2.0])}
    sensing = Sensing({"0": config(rate_hz=rate_hz)}, [emitter()], seed=1)
    places = Places(ways["0"][np.newaxis]), Places(ways["beacon"][np.newaxis])
    hour = range(72_000, 72_200)
    at = {int(n): tick for tick in hour for n in sensing.measure(tick * TICK_NS, *places).number}
    numbers = sorted(at)[1:]  # the first was due before
    assert len(numbers) > 25
    assert [at[n] for n in numbers] == [-(-n * 20 // int(rate_hz)) for n in numbers]


@pytest.mark.slow
def test_fading_goes_with_the_carrier_of_the_emitter() -> None:
    """Clarke: in a ring the power has the correlation J0(2 pi d / lambda)^2, lambda the emitter's wavelength."""
    radio = PLAIN | {"fading": {"model": "rayleigh", "coherence": "doppler", "max_coherence_s": 1e4}}
    sensors, emitters = {"0": config(radio, band_hz=(1e8, 6e9))}, [emitter(frequency_hz=2.4e9)]
    way_m = 0.1 * 299_792_458.0 / 2.4e9
    track = HERE + np.outer(np.arange(2000) * way_m, [1.0, 0.0, 0.0])
    ways = {"0": track, "beacon": np.array([900.0, 500.0, -2.0])}
    fades = [measured(sensors, emitters, ways, seed=seed, ticks=2000).fading_db for seed in range(3)]
    varying = 10.0 ** (0.1 * np.array(fades)) - 1.0
    lags = (1, 2, 4)
    found = [np.mean(varying[:, lag:] * varying[:, :-lag]) / np.mean(varying**2) for lag in lags]
    assert found == pytest.approx([special.j0(0.2 * np.pi * lag) ** 2 for lag in lags], abs=0.05)


def test_the_mean_is_the_link_budget_from_emitter_to_sensor() -> None:
    sector = {"model": "sector", "gain_db": 9.0, "front_to_back_db": 25.0, "elevation_beamwidth_deg": 180.0}
    emitters = [
        emitter("near", power_dbm=3.0),
        emitter("high", frequency_hz=434.0e6),
        emitter("front", antenna=sector),
    ]
    ways = {
        "0": np.array([0.0, 0.0, -40.0]),
        "near": np.array([0.0, 50.0, -40.0]),
        "high": np.array([0.0, 500.0, -40.0]),
        "front": np.array([-100.0, 0.0, -40.0]),
    }
    found = measured({"0": config(PLAIN)}, emitters, ways)
    expected = [
        law_dbm(np.array(50.0), 3.0),
        law_dbm(np.array(500.0), 20.0, 434.0e6),
        law_dbm(np.array(100.0), 29.0),
    ]
    assert found.mean_power_dbm == pytest.approx([float(each) for each in expected], abs=1e-6)
    assert found.reading_dbm == pytest.approx(found.mean_power_dbm, abs=0.01)
    assert (found.shadowing_db.tolist(), found.fading_db.tolist()) == ([0.0] * 3, [0.0] * 3)


def rma_av_without_sight_dbm(distance_m: float, aircraft_m: float) -> float:
    """Of 20 dBm: TR 36.777 V15.0.0, table B-2, RMa-AV without line of sight."""
    f_db = 20.0 * math.log10(40.0 * math.pi * CARRIER_HZ / 1e9 / 3.0)
    clear_db = max(23.9 - 1.8 * math.log10(aircraft_m), 20.0) * math.log10(distance_m) + f_db
    slope = 35.0 - 5.3 * math.log10(min(max(aircraft_m, 10.0), 40.0))
    return 20.0 - max(clear_db, -12.0 + slope * math.log10(distance_m) + f_db)


ROLES = PLAIN | {"propagation": {"model": "rma-av", "outside": "clamp", "line_of_sight": "never"}}


@pytest.mark.parametrize(
    ("sensor_m", "emitter_m", "bases", "aircraft_m"),
    [
        (2.0, 100.0, ["0"], 100.0),
        (
            100.0,
            2.0,
            ["0"],
            10.0,
        ),  # a mast, and what creeps along the ground counts as the aircraft: at 10 m, clamped
        (2.0, 100.0, [], 10.0),
        (100.0, 2.0, [], 100.0),
    ],
)
def test_a_sensor_on_the_ground_is_the_base_as_a_radio_there_is(
    sensor_m: float, emitter_m: float, bases: list[str], aircraft_m: float
) -> None:
    """By the table, as interference of the emitter at a radio in the sensor's place, and as agents reckon it."""
    here, there = np.array([0.0, 0.0, -sensor_m]), np.array([1000.0, 0.0, -emitter_m])
    sensor, ways = config(ROLES), {"0": here, "beacon": there}
    found = measured({"0": sensor}, [emitter()], ways, bases=bases)
    expected_dbm = rma_av_without_sight_dbm(math.hypot(1000.0, emitter_m - sensor_m), aircraft_m)
    assert found.mean_power_dbm == pytest.approx([expected_dbm], abs=1e-9)
    radio = Radio(sensor.radio, [emitter()])
    path = radio.path(
        position_tx_ned_m=[0.0, 10.0, -50.0], position_rx_ned_m=here, base="rx" if bases else "tx"
    )
    noise_dbm = float(np.asarray(radio.noise_dbm(path._replace(emitters_ned_m={"beacon": there}))))
    watts = 10.0 ** (noise_dbm / 10.0) - 10.0 ** (radio.noise_floor_dbm / 10.0)
    assert 10.0 * math.log10(watts) == pytest.approx(expected_dbm, abs=1e-3)
    known = Sensor(sensor, is_base=bool(bases)).expected_power_dbm(there, here, power_dbm=20.0)
    assert float(known) == pytest.approx(expected_dbm, abs=1e-9)


def test_only_what_is_in_the_band_is_measured() -> None:
    frequencies = (433.8e6, 433.83e6, 434.01e6, 434.1e6)
    emitters = [emitter(f"e{i}", frequency_hz=each) for i, each in enumerate(frequencies)]
    ways = {"0": HERE} | {each.name: np.array([100.0, 0.0, 0.0]) for each in emitters}
    assert measured({"0": config()}, emitters, ways).emitter.tolist() == [1, 2]
    wide = config(band_hz=(433.0e6, 434.05e6))
    assert measured({"0": wide}, emitters, ways).emitter.tolist() == [0, 1, 2]


def test_every_outcome_has_its_cause() -> None:
    emitters = [
        emitter("loud"),
        emitter("faint", power_dbm=-110.0),
        emitter("off", duty=0.0),
        emitter("far"),
    ]
    ways = {"0": HERE, "far": np.array([9000.0, 0.0, -2.0])}
    ways |= {name: np.array([100.0, 0.0, -2.0]) for name in ("loud", "faint", "off")}
    found = measured({"0": config(PLAIN | {"max_range_m": 5000.0})}, emitters, ways)
    assert outcomes(found) == ["measured", "below_threshold", "silent", "out_of_range"]
    assert np.isnan(found.power_dbm).tolist() == [False, True, True, True]
    assert np.isnan(found.reading_dbm).tolist() == [False, False, True, True]
    assert not np.isnan(found.mean_power_dbm).any()


def test_where_nobody_was_seen_nothing_is_measured() -> None:
    from channel.sensing.measured import Places

    sensing = Sensing({"0": config(), "1": config()}, [emitter()], seed=1)
    places = Places(np.zeros((2, 3)), known=np.array([False, True]))
    found = sensing.measure(0, places, Places(np.array([[100.0, 0.0, 0.0]])))
    assert outcomes(found) == ["no_position", SensingOutcome.MEASURED.value]
    assert np.isnan(found.mean_power_dbm).tolist() == [True, False]


def test_a_pulsed_emitter_is_heard_in_its_share_of_slots_by_all_alike() -> None:
    pulsed = emitter(duty=0.3, slot_s=0.05)
    sensors = {"0": config(PLAIN), "1": config(PLAIN)}
    ways = {"0": HERE, "1": HERE + 5.0, "beacon": np.array([100.0, 0.0, -2.0])}
    found = measured(sensors, [pulsed], ways, ticks=2000)
    heard = found.outcome.reshape(2000, 2) == 0
    assert (heard[:, 0] == heard[:, 1]).all()
    assert abs(int(heard[:, 0].sum()) - 600) < 3.29 * np.sqrt(2000 * 0.3 * 0.7)


def test_the_threshold_and_the_step_apply_to_the_reading() -> None:
    """At a mean 3 dB over the noise and a threshold of 4.77 dB (twice the noise in power over it), half are told."""
    floor_dbm = 10.0 * np.log10(1.380649e-23 * 290.0 * 200e3 * 1e3) + 8.0
    weak = emitter(power_dbm=20.0 + floor_dbm + 3.0103 - float(law_dbm(np.array(100.0))))
    ways = {"0": np.zeros(3), "beacon": np.array([100.0, 0.0, 0.0])}
    sensor = config(PLAIN, averages=100, threshold_db=4.7712, step_db=0.5)
    found = measured({"0": sensor}, [weak], ways, ticks=1000)
    over = found.reading_dbm >= round(floor_dbm + 4.7712, 3)
    assert (over == (found.outcome == 0)).all()
    assert abs(int(over.sum()) - 500) < 60  # 3.8 standard deviations
    assert found.power_dbm[over] == pytest.approx(np.rint(found.reading_dbm[over] * 2.0) / 2.0, abs=1e-9)


def test_shadowing_has_its_law_and_its_decorrelation_distance() -> None:
    """Over seeds: N(0, sigma^2) at a place, exp(-d / d_corr) between two places of the sensor, 0 between emitters."""
    shadowing = {"model": "gudmundson", "sigma_db": 4.0, "decorrelation_m": 25.0}
    sensor = config({"fading": {"model": "none"}, "shadowing": shadowing})
    way = np.array([[0.0, 0.0, -40.0], [0.0, 10.0, -40.0], [25.0, 0.0, -40.0], [60.0, 60.0, -40.0]])
    emitters = [emitter(f"e{i}") for i in range(6)]
    ways = {"0": way} | {each.name: np.array([300.0, 40.0 * i, -2.0]) for i, each in enumerate(emitters)}
    z = np.array(
        [
            measured({"0": sensor}, emitters, ways, seed=seed, ticks=4).shadowing_db.reshape(4, 6) / 4.0
            for seed in range(250)
        ]
    )
    assert stats.kstest(z[:, 0].ravel(), stats.norm.cdf).pvalue > 1e-3
    for place, distance_m in ((1, 10.0), (2, 25.0), (3, np.hypot(60.0, 60.0))):
        product = (z[:, 0] * z[:, place]).mean(axis=1)
        error = product.std() / np.sqrt(len(product))
        assert product.mean() == pytest.approx(np.exp(-distance_m / 25.0), abs=3.29 * error)
    between = (z[:, 0, 0] * z[:, 0, 1]).mean()
    assert abs(between) < 3.29 / np.sqrt(250)


def test_rayleigh_fading_with_noise_is_exponential() -> None:
    """One sample of a Rayleigh-faded signal and noise: the sum of two complex normal variables."""
    sensor = config({"shadowing": {"model": "none"}, "fading": {"model": "rayleigh"}}, averages=1)
    floor_dbm = 10.0 * np.log10(1.380649e-23 * 290.0 * 200e3 * 1e3) + 8.0
    weak = emitter(power_dbm=20.0 + floor_dbm - float(law_dbm(np.array(100.0))))
    ways = {"0": np.zeros(3), "beacon": np.array([100.0, 0.0, 0.0])}
    found = measured({"0": sensor}, [weak], ways, ticks=3000)
    share = 10.0 ** ((found.reading_dbm - floor_dbm) / 10.0) / 2.0
    assert stats.kstest(share, stats.expon.cdf).pvalue > 1e-3


def test_names_have_to_differ() -> None:
    with pytest.raises(ChannelInputError, match="names that differ"):
        Sensing({"0": config()}, [Emitter(name="0", frequency_hz=CARRIER_HZ, power_dbm=0.0)], seed=1)


def test_without_emitters_there_is_nothing() -> None:
    assert measured({"0": config()}, [], {"0": HERE}, ticks=3).size == 0
