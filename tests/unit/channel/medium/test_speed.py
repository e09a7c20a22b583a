"""Fading that lasts for a coherence time sees how fast the two ends move, from their positions alone."""

import math

import numpy as np
import pytest

from channel import presets
from channel.link.radio import Radio
from channel.medium.medium import Medium
from tests.unit.channel.medium.one_by_one import rows, transmitted

TICK_NS = 50_000_000
FREQUENCY_HZ = 100e6
LIGHT_MPS = 299_792_458.0
LONGEST_S = 1.0
ROUNDED_DB = 0.0021
"""Two powers in steps of 0.001 dB, each 0.0005 dB off, and the wanted powers at distances in mm."""
FADING = {"model": "rayleigh", "coherence": "doppler", "max_coherence_s": LONGEST_S}
RADIO = Radio(
    presets.load_radio(
        "corrected", {"frequency_hz": FREQUENCY_HZ, "shadowing": {"model": "none"}, "fading": FADING}
    )
)


def block_ns(speed_mps):
    """Coherence time 9 / (16 pi f_doppler) of the textbook, rounded down to a power of two."""
    doppler_hz = speed_mps / LIGHT_MPS * FREQUENCY_HZ
    coherence_s = min(9.0 / (16.0 * math.pi * doppler_hz), LONGEST_S) if doppler_hz else LONGEST_S
    return 2 ** math.floor(math.log2(coherence_s * 1e9))


def gains_db(velocities_ned_mps, every_ns, packets):
    """Times and fading of packets from node 0 to node 1, which fly straight on from 300 m apart."""
    medium = Medium(RADIO, seed=5, nodes=["0", "1"])
    starts = ((0.0, 0.0, -50.0), (0.0, 300.0, -50.0))
    settled = []
    for tick in range(1 + math.ceil(every_ns * (packets + 1) / TICK_NS)):
        for node, (start, velocity) in enumerate(zip(starts, velocities_ned_mps, strict=True)):
            position = tuple(p + v * tick * TICK_NS / 1e9 for p, v in zip(start, velocity, strict=True))
            medium.observe(str(node), tick * TICK_NS, position)
    for seq in range(1, packets + 1):
        settled += transmitted(medium, "0", seq, seq * every_ns, 40)
    settled += rows(medium, medium.flush())
    mean_dbm = RADIO.link([each.distance_m for each in settled]).received_power_dbm
    times_ns = np.array([each.sim_time_ns for each in settled])
    return times_ns, np.array([each.received_power_dbm for each in settled]) - mean_dbm


STILL = (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("velocities_ned_mps", "speed_mps"),
    [
        ((STILL, STILL), 0.0),
        ((STILL, (0.0, 3.0, 0.0)), 3.0),
        (((0.0, -6.0, 0.0), (0.0, 6.0, 0.0)), 12.0),
        ((STILL, (3.6, 0.0, 4.8)), 6.0),
        (((15.0, 0.0, 0.0), (15.0, 0.0, 0.0)), 0.0),
    ],
)
def test_fading_lasts_for_the_coherence_time_of_the_relative_speed(velocities_ned_mps, speed_mps):
    length_ns = block_ns(speed_mps)
    times_ns, gain_db = gains_db(velocities_ned_mps, length_ns // 8, 80)
    same_block = np.diff(times_ns // length_ns) == 0
    step_db = np.abs(np.diff(gain_db))
    assert np.count_nonzero(~same_block) == 10
    assert np.all(step_db[same_block] < ROUNDED_DB)
    assert np.all(step_db[~same_block] > 2.0 * ROUNDED_DB)


def test_the_speeds_of_the_test_have_blocks_of_their_own():
    lengths = [block_ns(speed) for speed in (0.0, 3.0, 6.0, 12.0)]
    assert lengths == [2**29, 2**27, 2**26, 2**25]


def test_a_change_of_speed_is_seen_at_once():
    medium = Medium(RADIO, seed=5, nodes=["0", "1"])
    medium.place("0", (0.0, 0.0, -50.0))
    east_m, settled = 300.0, []
    for tick in range(60):
        medium.observe("1", tick * TICK_NS, (0.0, east_m, -50.0))
        settled += transmitted(medium, "0", tick, max(tick - 1, 0) * TICK_NS, 40)
        east_m += 0.0 if tick < 30 else 12.0 * TICK_NS / 1e9
    mean_dbm = RADIO.link([each.distance_m for each in settled]).received_power_dbm
    gain_db = np.array([each.received_power_dbm for each in settled]) - mean_dbm
    assert len(set(gain_db[:30].round(2))) <= math.ceil(30 * TICK_NS / 2**29)
    assert len(set(gain_db[32:].round(2))) == len(gain_db[32:])
