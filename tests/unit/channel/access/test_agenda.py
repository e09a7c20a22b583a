"""Events of several networks on one clock."""

from __future__ import annotations

import numpy as np

from channel.access.agenda import ACTS, SIGNAL_ENDS, SIGNAL_STARTS, Agenda, SharedClock
from channel.access.media.csma import Csma
from channel.access.packets import AirPacket
from channel.access.timing import wifi_g
from channel.access.world import PlainWorld


def test_events_come_by_time_then_rank_then_network_then_node_then_number() -> None:
    rng = np.random.default_rng(5)
    agendas = Agenda(), Agenda(), Agenda()
    SharedClock(agendas)
    expected, found = [], []
    for number in range(400):
        network, at_ns, node = (int(rng.integers(0, n)) for n in (3, 20, 4))
        rank = int(rng.choice([SIGNAL_ENDS, ACTS, SIGNAL_STARTS]))
        entry = agendas[network].at(at_ns, rank, node, found.append, (at_ns, rank, network, node, number))
        if rng.random() < 0.1:
            agendas[network].call_off(entry)
        else:
            expected.append((at_ns, rank, network, node, number))
    agendas[1].run(7)
    assert found == sorted(each for each in expected if each[0] <= 7)
    assert [agenda.now_ns for agenda in agendas] == [7, 7, 7]
    agendas[0].run(100)
    assert found == sorted(expected)
    assert [agenda.now_ns for agenda in agendas] == [100, 100, 100]


def test_an_event_may_add_one_to_another_network_at_the_same_instant() -> None:
    first, second = Agenda(), Agenda()
    SharedClock((first, second))
    found: list[str] = []
    second.at(5, ACTS, 0, first.at, 5, SIGNAL_STARTS, 0, found.append, "first, told by the second")
    second.at(5, SIGNAL_STARTS, 0, found.append, "second")
    first.run(5)
    assert found == ["first, told by the second", "second"]


def csma(seed: int) -> Csma:
    """Five stations at ways of 300 ns, under load."""
    medium = Csma(PlainWorld(list(range(5)), delay_ns=300, loss=0.1), wifi_g(), seed=seed)
    rng = np.random.default_rng(seed)
    for number, at_ns in enumerate(np.sort(rng.integers(0, 200_000_000, 300)).tolist()):
        node, other = rng.choice(5, 2, replace=False).tolist()
        medium.offer(AirPacket(node, number, other if rng.random() < 0.5 else None, 400, at_ns))
    return medium


def test_networks_that_only_share_a_clock_do_what_they_do_alone() -> None:
    alone = [repr(csma(seed).run(1_000_000_000)) for seed in (1, 2)]
    media = [csma(seed) for seed in (1, 2)]
    SharedClock([medium.agenda for medium in media])
    assert [repr(medium.run(1_000_000_000)) for medium in media] == alone
