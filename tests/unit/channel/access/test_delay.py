"""Delays, outages and rates of the medium `delay`, against the laws that they are drawn from."""

from __future__ import annotations

from math import exp, inf, log, sqrt

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from channel.access.media.delay import Delay, DelaySettings, Outage, WayDelay
from channel.access.packets import AirFate, AirPacket, Loss, Outcome, Reply
from channel.access.queue import QueueLimits
from channel.access.settings.base import Surroundings
from channel.access.settings.delay import DelayMedium
from channel.access.words import WordStream
from channel.access.world import PlainWorld
from channel.draws import Draws
from channel.preset_errors import PresetError
from channel.presets import radio_from_mapping

MS, S = 1_000_000, 1_000_000_000
UNLIMITED = QueueLimits(0)
FAST = 1e12
"""bit/s: packets of 100 bytes take 1 ns."""
LTE = WayDelay(20 * MS, 45 * MS, 120 * MS)


def fates(outcomes: list[Outcome]) -> list[AirFate]:
    """Without replies."""
    return [one for one in outcomes if isinstance(one, AirFate)]


def delays_ms(settings: DelaySettings, count: int, each_ns: int) -> NDArray[np.float64]:
    """Of packets that one node sends to another, in the order in which they were sent."""
    medium = Delay(PlainWorld((0, 1)), settings, seed=11)
    for number in range(count):
        medium.offer(AirPacket(0, number, 1, 100, number * each_ns))
    found = sorted(fates(medium.run(count * each_ns + 100 * S)), key=lambda fate: fate.packet.number)
    assert len(found) == count
    return np.array([fate.at_ns - fate.ended_ns for fate in found]) / MS


@pytest.mark.slow
def test_delays_have_their_distribution() -> None:
    """Kolmogorov-Smirnov at 1 %, of so many independent draws that a median 2 % off is told from the right one.

    The rest above 20 ms has median 25 and 95 % 100 ms: s = ln 4 / 1.644854.
    """
    count = 60_000
    settings = DelaySettings(LTE, rate_bps=FAST, keeps_order=False)
    delays = delays_ms(settings, count, MS)
    level, spread = 1.628 / sqrt(count), log(4.0) / 1.644854
    assert stats.kstest(delays, stats.lognorm(spread, 20.0, 25.0).cdf).statistic < level
    assert stats.kstest(delays, stats.lognorm(spread, 20.0, 25.0 * 1.02).cdf).statistic > level
    successive = np.corrcoef(stats.rankdata(delays[1:]), stats.rankdata(delays[:-1]))[0, 1]
    assert abs(successive) < 4.0 / sqrt(count)


def test_a_constant_delay_is_constant() -> None:
    """To the nanosecond, for all."""
    settings = DelaySettings(WayDelay.constant(270 * MS), rate_bps=FAST)
    assert set(delays_ms(settings, 50, MS).tolist()) == {270.0}


def test_packets_keep_their_order_if_asked() -> None:
    """Sent each ms with delays of tens of ms: each arrives when it and all before it have come, or as drawn."""
    count = 2000
    as_drawn = delays_ms(DelaySettings(LTE, rate_bps=FAST, keeps_order=False), count, MS) + np.arange(count)
    in_order = delays_ms(DelaySettings(LTE, rate_bps=FAST), count, MS) + np.arange(count)
    assert (np.diff(as_drawn) < 0.0).mean() > 0.3
    assert in_order == pytest.approx(np.maximum.accumulate(as_drawn), abs=1e-6)


def test_the_order_of_packets_that_arrive_at_one_instant_is_theirs() -> None:
    """As they come out, not only by their instants."""
    medium = Delay(PlainWorld((0, 1, 2)), DelaySettings(LTE, rate_bps=FAST))
    for number in range(500):
        medium.offer(AirPacket(0, number, None, 100, number * MS))
    found = fates(medium.run(10 * S))
    for receiver in (1, 2):
        assert [fate.packet.number for fate in found if fate.receiver == receiver] == list(range(500))


def states(good_s: float, bad_s: float, step_s: float, until_s: float) -> NDArray[np.bool_]:
    """Of one outage, at equal steps."""
    outage = Outage(WordStream(Draws(3), "0", "outage"), good_s, bad_s)
    step_ns = int(step_s * S)
    return np.array([outage.is_down(step * step_ns) for step in range(int(until_s / step_s))])


def test_outages_are_a_two_state_process() -> None:
    """Share, mean durations and memory; bounds are four standard deviations of data correlated in time.

    Down p = 1/5 of the time, correlated as exp(-t / tau), tau = 1 / (1/2 + 1/0.5) = 0.4 s; the share of a time T has
    the variance 2 p (1 - p) tau / T. One duration of 2.5 s mean each: 12000 of each state in 30000 s.
    """
    step_s, until_s = 0.02, 30_000.0
    down = states(2.0, 0.5, step_s, until_s)
    assert down.mean() == pytest.approx(0.2, abs=4.0 * sqrt(2.0 * 0.16 * 0.4 / until_s))
    turns = np.flatnonzero(np.diff(down))
    lengths = np.diff(turns) * step_s
    first_is_down = bool(down[turns[0] + 1])
    of_down, of_good = lengths[int(not first_is_down) :: 2], lengths[int(first_is_down) :: 2]
    for seen, mean_s in ((of_down, 0.5), (of_good, 2.0)):
        beyond = [(seen >= share * mean_s).mean() for share in (0.5, 1.0, 2.0)]  # unseen: shorter than a step
        assert len(seen) > 11_000
        assert np.log(beyond[0] / beyond[2]) == pytest.approx(1.5, rel=0.04)
        assert np.log(beyond[0] / beyond[1]) == pytest.approx(0.5, rel=0.05)
    for lag_s in (0.2, 0.4, 0.8):
        lag = int(lag_s / step_s)
        memory = np.corrcoef(down[lag:], down[:-lag])[0, 1]
        assert memory == pytest.approx(exp(-lag_s / 0.4), abs=0.02)


def test_packets_are_lost_while_the_line_of_either_end_is_down() -> None:
    """Both ends are up (4/5)^2 of the time, independently; when the sender is down, nobody has the packet.

    The product of two such processes has the covariance 2 q^3 p e^-t/tau + q^2 p^2 e^-2t/tau. A look each tau / 4 says
    as much of it as one at all times: the variance of the mean is larger by (x coth x - 1) = 0.5 %, x = 1 / 8.
    """
    p, q, tau_s, until_s, each_ns = 0.2, 0.8, 0.4, 400, 100 * MS
    settings = DelaySettings(WayDelay.constant(30 * MS), rate_bps=FAST, good_s=2.0, bad_s=0.5)
    medium = Delay(PlainWorld(range(6)), settings, seed=5)
    for number in range(until_s * S // each_ns):
        medium.offer(AirPacket(0, number, None, 100, number * each_ns))
    lost = np.zeros((until_s * S // each_ns, 5), dtype=bool)
    for fate in fates(medium.run(until_s * S + S)):
        assert fate.loss in (None, Loss.OUTAGE)
        lost[fate.packet.number, fate.receiver - 1] = fate.loss is not None
    deviation = sqrt(2.0 / until_s * (2.0 * q**3 * p * tau_s + q**2 * p**2 * tau_s / 2.0))
    for receiver in range(5):
        assert lost[:, receiver].mean() == pytest.approx(1.0 - q**2, abs=4.0 * deviation)
    for_all = lost.all(axis=1)
    assert for_all.mean() == pytest.approx(p, abs=4.0 * sqrt(2.0 * p * q * tau_s / until_s))
    left = lost[~for_all]
    assert abs(np.corrcoef(left[:, 0], left[:, 1])[0, 1]) < 0.15


def test_one_line_is_an_m_d_1_queue() -> None:
    """Packets leave as Lindley's recursion has it, to the ns; its mean wait is rho / (2 (1 - rho)) of a service time.

    The mean over 40000 packets has a standard deviation of 1.5 % (60 times the recursion); the bound is four of it. The
    medium is asked of the first 4000, which wait in hundreds of busy periods.
    """
    service_ns, load, count, asked = 12_500_000, 0.5, 40_000, 4000
    rng = np.random.default_rng(5)
    instants = np.cumsum(rng.exponential(service_ns / load, count)).astype(np.int64).tolist()
    settings = DelaySettings(WayDelay.constant(0), rate_bps=64_000.0)
    medium = Delay(PlainWorld((0, 1)), settings, limits=UNLIMITED)
    for number, at_ns in enumerate(instants[:asked]):
        medium.offer(AirPacket(0, number, 1, 100, at_ns))
    found = fates(medium.run(instants[-1]))
    free_ns, leave_ns = 0, []
    for at_ns in instants:
        free_ns = max(free_ns, at_ns) + service_ns
        leave_ns.append(free_ns)
    assert [fate.at_ns for fate in found] == leave_ns[:asked]
    waits = np.array(leave_ns) - service_ns - instants
    assert [fate.started_ns - fate.packet.at_ns for fate in found] == waits[:asked].tolist()
    assert np.mean(waits) / service_ns == pytest.approx(0.5, rel=0.06)


def test_a_queue_that_is_full_loses_what_is_too_much() -> None:
    """D/D/1: 100 bytes each 5 ms into 80 kb/s, 10 ms each: half are lost, the others wait for three before them."""
    settings = DelaySettings(WayDelay.constant(MS), rate_bps=80_000.0)
    medium = Delay(PlainWorld((0, 1)), settings, limits=QueueLimits(3))
    for number in range(1000):
        medium.offer(AirPacket(0, number, 1, 100, number * 5 * MS))
    outcomes = medium.run(100 * S)
    lost = [fate for fate in fates(outcomes) if fate.loss is Loss.QUEUE_FULL]
    came = [fate for fate in fates(outcomes) if fate.loss is None]
    assert len(came) == pytest.approx(500, abs=4)
    assert len(lost) + len(came) == 1000
    assert {fate.at_ns - fate.packet.at_ns for fate in came[10:-4]} <= {36 * MS, 41 * MS}
    assert [reply.packet for reply in outcomes if isinstance(reply, Reply)] == [fate.packet for fate in lost]


@pytest.mark.slow
def test_neither_bystanders_nor_the_length_of_a_run_matter() -> None:
    """What three nodes send to each other fares the same to the ns with seven others that send much."""
    settings = DelaySettings(LTE, rate_bps=1e6, good_s=1.0, bad_s=0.2)
    rng = np.random.default_rng(1)
    packets = [
        AirPacket(int(rng.integers(3)), number, None, int(rng.integers(2000)), number * 3 * MS)
        for number in range(1000)
    ]

    def seen(nodes: int, step_ns: int) -> list[AirFate]:
        medium = Delay(PlainWorld(range(nodes), loss=0.1), settings)
        for packet in packets:
            medium.offer(packet)
        for number in range(500):
            for node in range(3, nodes):
                medium.offer(AirPacket(node, number, None, 1000, number * 6 * MS))
        outcomes = [one for until_ns in range(0, 5 * S, step_ns) for one in medium.run(until_ns)]
        return [one for one in fates(outcomes) if one.receiver < 3 and one.packet.node < 3]

    alone = seen(3, 50 * MS)
    assert {fate.loss for fate in alone} == {None, Loss.OUTAGE, Loss.NOISE}
    assert seen(10, 4 * S) == [fate for fate in alone if fate.at_ns <= 4 * S]


def test_the_losses_of_the_world_count() -> None:
    """Each receiver of a broadcast loses its share; who is deaf to the sender has nothing."""
    world = PlainWorld((0, 1, 2), loss=0.3, deaf=((0, 2),))
    medium = Delay(world, DelaySettings(WayDelay.constant(0)), limits=UNLIMITED)
    for number in range(5000):
        medium.offer(AirPacket(0, number, None, 10, number * MS))
    found = fates(medium.run(10 * S))
    shares = {
        receiver: np.mean([fate.loss is Loss.NOISE for fate in found if fate.receiver == receiver])
        for receiver in (1, 2)
    }
    assert shares[1] == pytest.approx(0.3, abs=4.0 * sqrt(0.21 / 5000))
    assert shares[2] == 1.0


def test_a_packet_that_comes_to_a_radio_that_is_off_by_then_is_lost() -> None:
    """Two seconds on its way; off from 5 s on, and on again at 9 s."""

    class Switching(PlainWorld):
        def is_off(self, node: int, at_ns: int) -> bool:
            """Node 1, for four seconds."""
            return node == 1 and 5 * S <= at_ns < 9 * S

    medium = Delay(Switching((0, 1)), DelaySettings(WayDelay.constant(2 * S), rate_bps=FAST))
    for number in range(10):
        medium.offer(AirPacket(0, number, 1, 1, number * S))
    came = [fate.packet.number for fate in fates(medium.run(20 * S)) if fate.loss is not Loss.RADIO_OFF]
    assert came == [0, 1, 2, 7, 8, 9]


def test_mistakes_are_said() -> None:
    """With what is wrong."""
    with pytest.raises(ValueError, match="rising"):
        WayDelay(20, 10, 30)
    with pytest.raises(ValueError, match="median and 95 % equal"):
        WayDelay(20, 20, 30)
    with pytest.raises(ValueError, match="service of 0 s"):
        DelaySettings(LTE, good_s=0.0)
    with pytest.raises(ValueError, match="bit rate 0"):
        Delay(PlainWorld((0, 1)), DelaySettings(LTE, rate_bps=0.0))


@pytest.mark.parametrize(
    ("good_s", "bad_s"), [(1e300, 1.0), (1.0, 1e300), (60.0, inf), (1e-9, 1.0), (1.0, 1e-9)]
)
def test_times_that_no_clock_counts_are_refused(good_s: float, bad_s: float) -> None:
    """In ns they are no number, an endless outage never began, and of short ones a second has too many."""
    with pytest.raises(ValueError, match=r"service of .*: from 0\.001 to 1e\+09, the latter may be 0"):
        DelaySettings(WayDelay.constant(0), good_s=good_s, bad_s=bad_s)


@pytest.mark.parametrize("rate_bps", [1e-300, inf])
def test_rates_at_which_no_frame_ends_are_refused(rate_bps: float) -> None:
    with pytest.raises(ValueError, match=r"bit rate .* bit/s: at least 0\.001"):
        Delay(PlainWorld((0, 1)), DelaySettings(WayDelay.constant(0), rate_bps))


@pytest.mark.parametrize(
    ("changed", "key"),
    [
        ({"median_s": 0.01}, "median_s: has to be at least least_s, 0.02, not 0.01"),
        ({"most_s": 0.03}, "most_s: has to be at least median_s, 0.04, not 0.03"),
        ({"median_s": 0.02}, "median_s: has to be above least_s, 0.02, unless most_s is the same"),
        ({"median_s": 0.02 + 4e-10}, "median_s: has to be above least_s, 0.02, unless most_s is the same"),
        ({"bad_s": 1e-9}, "bad_s: has to be 0, or at least 0.001, not 1e-09"),
        ({"rate_bps": 1e-4}, "rate_bps: has to be greater than or equal to 0.001"),
    ],
)
def test_a_mistake_in_a_radio_is_told_with_its_key_in_seconds(changed: dict[str, float], key: str) -> None:
    medium = {"model": "delay", "least_s": 0.02, "median_s": 0.04, "most_s": 0.1, "rate_bps": 1e6} | changed
    with pytest.raises(PresetError) as caught:
        radio_from_mapping({"preset": "perfect", "medium": medium})
    assert f"medium.{key}" in str(caught.value)


def test_the_share_without_an_outage_is_that_of_packets_that_arrive() -> None:
    """Two lines, each up for four of five seconds: 0.64, within four standard deviations of correlated packets."""
    medium = DelayMedium(least_s=0.0, median_s=0.0, most_s=0.0, rate_bps=FAST, good_s=4.0, bad_s=1.0)
    opened = medium.open(Surroundings(PlainWorld((0, 1)), {"0": 0, "1": 1}, 5, -100.0, {}))
    count = 20_000
    for number in range(count):
        opened.offer(AirPacket(0, number, 1, 100, number * S))
    came = np.mean([fate.loss is None for fate in fates(opened.run(count * S))])
    assert medium.up_share == pytest.approx(0.64)
    together = sum(2 * (0.64**2 * ((1 + exp(-1.25 * lag) / 4) ** 2 - 1)) for lag in range(1, 50))
    assert abs(came - 0.64) < 4 * sqrt((0.64 * 0.36 + together) / count)
