"""Media against formulas and published tables, none of which is the medium's own code."""

from __future__ import annotations

import re
from functools import partial
from math import ceil, exp
from pathlib import Path

import numpy as np
import pytest

from channel.access.media.airtime import AirTime
from channel.access.media.csma import Csma, DcfSettings
from channel.access.media.medium import AccessMedium
from channel.access.media.tdma import Schedule, Tdma
from channel.access.packets import AirFate, AirPacket, Loss
from channel.access.queue import QueueLimits
from channel.access.timing import BitRate, Wifi, wifi_a, wifi_b
from channel.access.world import PlainWorld

S = 1_000_000_000
UNLIMITED = QueueLimits(0)
long = partial(pytest.param, marks=pytest.mark.long)
STATIONS = (5, 15, 25, 30, 50)
SATURATION = {
    ("b", 1.0): ((0.8418, 0.7460, 0.6973, 0.6802, 0.6285), (0.8437, 0.7496, 0.7016, 0.6847, 0.6336)),
    ("b", 11.0): ((6.3821, 5.7718, 5.4217, 5.2958, 4.9103), (6.4734, 5.9553, 5.6429, 5.5289, 5.1745)),
    ("a", 6.0): ((4.6899, 4.1107, 3.8478, 3.7490, 3.4711), (4.7087, 4.1397, 3.8802, 3.7824, 3.5071)),
    ("a", 24.0): (
        (16.0836, 14.2327, 13.3595, 13.0281, 12.0889),
        (16.2470, 14.4904, 13.6496, 13.3288, 12.4144),
    ),
}
"""Mb/s with EIFS, and with DIFS, as ns-3's example wifi-bianchi prints: Bianchi, IEEE JSAC 18 (2000) 535, refined."""
BASIC_MBPS = {1.0: 1.0, 11.0: 2.0, 6.0: 6.0, 24.0: 24.0}
"""Of ns-3's acknowledgements at these rates."""
SHORT = [("b", 11.0, 5), ("a", 6.0, 5)]


def wifi(kind: str, rate_mbps: float) -> Wifi:
    """Of a row of the table."""
    return (wifi_b if kind == "b" else wifi_a)(rate_mbps, BASIC_MBPS[rate_mbps])


def delivered(medium: AccessMedium, until_ns: int) -> int:
    """How many receptions there were."""
    return sum(isinstance(one, AirFate) and one.loss is None for one in medium.run(until_ns))


def saturated_mbps(timing: Wifi, stations: int, frames: int, *, uses_eifs: bool) -> float:
    """Throughput of stations that always have a packet for node 0."""
    until_ns = int(frames * 1.35 * timing.duration_ns(1500))
    settings = DcfSettings(attempts_max=10**6, uses_eifs=uses_eifs)
    medium = Csma(PlainWorld(range(stations + 1)), timing, settings=settings, limits=UNLIMITED)
    for node in range(1, stations + 1):
        for number in range(2 * frames // stations + 40):
            medium.offer(AirPacket(node, number, 0, 1500, 0))
    came = delivered(medium, until_ns)
    assert all(medium.queued(node)[0] for node in range(1, stations + 1)), "saturated to the end"
    return came * 12_000 / until_ns * 1e3


def all_rows() -> list[object]:
    """The whole table takes a minute."""
    rows = [(kind, rate, n) for kind, rate in SATURATION for n in STATIONS]
    return [
        pytest.param(*row, marks=() if row in SHORT else (pytest.mark.slow, pytest.mark.long)) for row in rows
    ]


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "rate_mbps", "stations"), all_rows())
def test_saturated_unicast_has_bianchis_throughput(kind: str, rate_mbps: float, stations: int) -> None:
    """Within 2 %, with EIFS after collisions and without; 6000 frames, a standard deviation of about 0.4 %."""
    with_eifs, with_difs = (row[STATIONS.index(stations)] for row in SATURATION[kind, rate_mbps])
    timing = wifi(kind, rate_mbps)
    assert saturated_mbps(timing, stations, 6000, uses_eifs=True) == pytest.approx(with_eifs, rel=0.02)
    assert saturated_mbps(timing, stations, 6000, uses_eifs=False) == pytest.approx(with_difs, rel=0.02)


@pytest.mark.parametrize(
    ("cw_min", "stations", "share", "frames"),
    [
        (15, 10, 0.6595, 15_000),
        pytest.param(15, 2, 0.1174, 600_000, marks=(pytest.mark.slow, pytest.mark.long)),
        pytest.param(31, 2, 0.0604, 900_000, marks=(pytest.mark.slow, pytest.mark.long)),
        pytest.param(31, 10, 0.4278, 100_000, marks=(pytest.mark.slow, pytest.mark.long)),
    ],
)
@pytest.mark.slow
def test_saturated_broadcasts_collide_as_freeze_and_resume_has_it(
    cw_min: int, stations: int, share: float, frames: int
) -> None:
    """By exact countdown of counters that freeze; within 2 %, which is four standard deviations or more."""
    timing = Wifi(6.0, 6.0, 9_000, 16_000, cw_min, 1023, 20_000, 4_000)
    settings = DcfSettings(uses_eifs=False)  # else those that collided are the first to go on
    medium = Csma(PlainWorld(range(stations + 1)), timing, settings=settings, limits=UNLIMITED)
    for node in range(stations):
        for number in range(2 * frames // stations):
            medium.offer(AirPacket(node, number, None, 100, 0))
    fates = [
        one for one in medium.run(frames * timing.broadcast_ns(100) * 3 // 4) if isinstance(one, AirFate)
    ]
    heard = [fate for fate in fates if fate.receiver == stations]
    assert all(medium.queued(node)[0] for node in range(stations))
    assert {fate.loss for fate in heard} == {None, Loss.COLLIDED}
    collided = sum(fate.loss is Loss.COLLIDED for fate in heard) / len(heard)
    assert collided == pytest.approx(share, rel=0.02)


@pytest.mark.parametrize(("rate_mbps", "a_second"), [(6.0, 3361), (54.0, 7067)])
def test_one_saturated_broadcaster(rate_mbps: float, a_second: int) -> None:
    """DIFS, 7.5 slots on average and the frame; within 1 %."""
    timing = Wifi(rate_mbps, rate_mbps, 9_000, 16_000, 15, 1023, 20_000, 4_000, header_bytes=28)
    medium = Csma(PlainWorld((0, 1)), timing, limits=UNLIMITED)
    for number in range(8_000):
        medium.offer(AirPacket(0, number, None, 100, 0))
    assert delivered(medium, S) == pytest.approx(a_second, rel=0.01)


def poisson(rng: np.random.Generator, a_second: float, until_ns: int) -> list[int]:
    """Instants of a Poisson process, ns."""
    count = int(a_second * until_ns / S * 1.2 + 100)
    instants = np.cumsum(rng.exponential(S / a_second, count)).astype(np.int64)
    return [int(at) for at in instants if at < until_ns]


@pytest.mark.slow
@pytest.mark.parametrize(("load", "wait"), [long(0.3, 0.2143), (0.6, 0.75), long(0.9, 4.5)])
def test_one_sender_is_an_m_d_1_queue(load: float, wait: float) -> None:
    """Mean wait over service time: rho / (2 (1 - rho)) (Pollaczek and Khinchine)."""
    timing, service_ns = BitRate(64_000.0), 12_500_000
    until_ns = {0.3: 12_000, 0.6: 2500, 0.9: 12_000}[load] * S
    medium = AirTime(PlainWorld((0, 1)), timing, UNLIMITED)
    for number, at_ns in enumerate(poisson(np.random.default_rng(5), load * S / service_ns, until_ns)):
        medium.offer(AirPacket(0, number, 1, 100, at_ns))
    waits = [one.started_ns - one.packet.at_ns for one in medium.run(until_ns) if isinstance(one, AirFate)]
    assert np.mean(waits) / service_ns == pytest.approx(wait, rel=0.03)


@pytest.mark.slow
@pytest.mark.parametrize("load", [long(0.2), long(0.5), long(1.0)])
def test_many_that_do_not_listen_are_aloha(load: float) -> None:
    """G e^-2G (Abramson 1970), heard by a node that only listens."""
    stations, timing = 200, BitRate(1_000_000.0)
    frame_ns, until_ns = timing.duration_ns(125), 40 * S
    deaf = [(one, other) for one in range(stations) for other in range(stations) if one != other]
    medium = AirTime(PlainWorld(range(stations + 1), deaf=deaf), timing, UNLIMITED)
    rng = np.random.default_rng(7)
    for node in range(stations):
        for number, at_ns in enumerate(poisson(rng, load * S / frame_ns / stations, until_ns)):
            medium.offer(AirPacket(node, number, stations, 125, at_ns))
    throughput = delivered(medium, until_ns) * frame_ns / until_ns
    assert throughput == pytest.approx(load * exp(-2.0 * load), rel=0.03)


@pytest.mark.slow
@pytest.mark.parametrize("load", [long(0.05), 0.2])
def test_two_that_are_hidden_from_each_other(load: float) -> None:
    """Equal frames of two Poisson senders that listen, but are deaf to each other; four standard deviations at 0.2.

    A frame survives if the other, of load g, is silent at its start (1 - g), and begins nothing before its end (e^-g).
    """
    timing = Wifi(6.0, 6.0, 9_000, 16_000, 15, 1023, 20_000, 4_000)
    frame_ns, until_ns = timing.broadcast_ns(1500), 120 * S
    medium = Csma(PlainWorld((0, 1, 2), deaf=((0, 1), (1, 0))), timing, limits=UNLIMITED)
    rng = np.random.default_rng(3)
    for node in (0, 1):
        for number, at_ns in enumerate(poisson(rng, load * S / frame_ns, until_ns)):
            medium.offer(AirPacket(node, number, None, 1500, at_ns))
    heard = [one for one in medium.run(until_ns) if isinstance(one, AirFate) and one.receiver == 2]
    came = sum(fate.loss is None for fate in heard) / len(heard)
    assert came == pytest.approx((1.0 - load) * exp(-load), rel=0.03)


@pytest.mark.slow
@pytest.mark.parametrize(("a_second", "delay_ms"), [(1.0, 65.6), (5.0, 110.0)])
def test_mean_delay_of_slots(a_second: float, delay_ms: float) -> None:
    """Ten slots of 10 ms, one packet each: F / 2 + rho F / (2 (1 - rho)) + s."""
    nodes, until_ns = range(10), 600 * S
    medium = Tdma(PlainWorld(nodes), BitRate(80_000.0), Schedule.equal(tuple(nodes), 10_000_000), UNLIMITED)
    rng = np.random.default_rng(2)
    for node in nodes:
        for number, at_ns in enumerate(poisson(rng, a_second, until_ns)):
            medium.offer(AirPacket(node, number, (node + 1) % 10, 100, at_ns))
    fates = [one for one in medium.run(until_ns) if isinstance(one, AirFate)]
    assert all(fate.loss is None for fate in fates)
    assert np.mean([fate.at_ns - fate.packet.at_ns for fate in fates]) / 1e6 == pytest.approx(
        delay_ms, rel=0.03
    )


def lora_s(payload_bytes: int, spreading: int) -> float:
    """Time on the air at 125 kHz, 4/5, a preamble of 8, header and CRC: Semtech AN1200.13, section 4."""
    symbol_s = 2**spreading / 125e3
    low = 2 if symbol_s >= 0.016 else 0
    blocks = ceil((8 * payload_bytes - 4 * spreading + 28 + 16) / (4 * (spreading - low)))
    return (8 + 4.25 + 8 + 5 * max(blocks, 0)) * symbol_s


def documented() -> dict[int, tuple[float, float]]:
    """Bit rate and preamble by spreading factor, as docs/how-to/channel-which-model.md has them."""
    text = (Path(__file__).parents[4] / "docs/how-to/channel-which-model.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (\d+) \| ([\d.]+) \| ([\d.]+) \|$", text, re.MULTILINE)
    return {int(spreading): (float(rate), float(preamble)) for spreading, rate, preamble in rows}


@pytest.mark.parametrize("spreading", range(7, 13))
def test_the_recipe_for_lora_is_near_semtechs_formula(spreading: int) -> None:
    bit_rate_bps, preamble_s = documented()[spreading]
    timing = BitRate(bit_rate_bps, round(preamble_s * S))
    for payload_bytes in range(12, 201):
        found_s = timing.duration_ns(payload_bytes) / S
        assert found_s == pytest.approx(lora_s(payload_bytes, spreading), rel=0.07)
