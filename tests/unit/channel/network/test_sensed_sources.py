"""Carrier sense of interferers: stations that listen before they talk wait for them as for anybody.

IEEE 802.11-2020, 17.3.10.6: any signal from the energy level on holds the medium busy. Powers are free space.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from channel.access.air import Hearing
from channel.access.media.csma import NO_BACKOFF, Csma
from channel.access.packets import AirFate, AirPacket
from channel.access.timing import wifi_a
from channel.link.radio import Radio
from channel.medium.medium import Medium
from channel.network.radio_world import RadioWorld
from channel.network.sources import MediumSources
from channel.presets import radio_from_mapping
from channel.validity import OutsideValidityError
from tests.unit.channel.network.test_band import (
    MS,
    NOISE_DBM,
    RADIO,
    Came,
    Run,
    S,
    Sent,
    at,
    free_space_db,
    mw,
)

DIFS_NS, SLOT_NS, CCA_NS = 34_000, 9_000, 4_000
ENERGY_DBM = -62.0
"""The standard's, at 20 MHz, and csma's default."""
PLACES = {"1": 0.0, "2": 100.0}
AWAY_M = 200.0
"""From node 1 to the interferer, away from node 2."""
EVERY_50_MS = [Sent("1", number * 50 * MS + 7 * MS) for number in range(20)]
LBT_NS = 311 * 15_673
"""312 ticks of silence, of which the first may have begun already."""


def jammer(power_dbm: float, **more: Any) -> dict[str, Any]:
    return {"position_ned_m": [-AWAY_M, 0.0, -100.0], "power_dbm": power_dbm, **more}


def jammed(*interferers: dict[str, Any], medium: dict[str, Any] | None = None, **more: Any) -> dict[str, Any]:
    interference = {"rejection": [[0.0, 0.0]], "interferers": interferers, **more}
    csma = {"model": "csma", "standard": "11a"}
    return RADIO | {"interference": interference, "medium": csma | (medium or {})}


def came(
    radio: Any, sent: Sequence[Sent], until_ns: int = S, tick_ns: int = 50 * MS, **places: float
) -> list[Came]:
    return Run({"a": (radio, PLACES | places)}, tick_ns).fates({"a": sent}, until_ns)["a"]


@pytest.mark.parametrize("over_db", [-0.01, 0.01])
def test_a_station_waits_while_an_interferer_is_at_the_energy_level(over_db: float) -> None:
    """It is heard for ever: what was sent waits, and what finds no room in the queue is lost."""
    power_dbm = ENERGY_DBM + free_space_db(AWAY_M) + over_db
    radio = jammed(jammer(power_dbm), medium={"queue": {"packets": 3}})
    found = came(radio, EVERY_50_MS)
    if over_db < 0.0:
        assert [each.started_ns - each.entered_ns for each in found] == [DIFS_NS] * 20
    else:  # one is at the transmitter, three are in the queue
        assert [each.fate for each in found] == ["queue_full"] * 16
        assert [each.started_ns for each in found] == [-1] * 16


@pytest.mark.parametrize("over_db", [-0.01, 0.01])
def test_what_the_filter_takes_is_not_sensed(over_db: float) -> None:
    """60 kHz beside the carrier, where it takes 20 dB."""
    carrier_hz = RADIO["frequency_hz"] + 60e3
    power_dbm = ENERGY_DBM + free_space_db(AWAY_M, carrier_hz) + 20.0 + over_db
    radio = jammed(jammer(power_dbm, frequency_hz=carrier_hz), rejection=[[0.0, 0.0], [50e3, 20.0]])
    assert at(came(radio, EVERY_50_MS[:1]), "2") == ([] if over_db > 0.0 else ["delivered"])


@pytest.mark.parametrize("over_db", [-0.01, 0.01])
def test_two_interferers_are_sensed_together(over_db: float) -> None:
    power_dbm = ENERGY_DBM + free_space_db(AWAY_M) - 10.0 * np.log10(2.0) + over_db
    found = came(jammed(jammer(power_dbm), jammer(power_dbm)), EVERY_50_MS[:1])
    assert at(found, "2") == ([] if over_db > 0.0 else ["delivered"])


@pytest.mark.parametrize("over_db", [-0.01, 0.01])
def test_an_interferer_and_a_frame_are_sensed_together(over_db: float) -> None:
    """A frame that is too weak to be locked on to, with the power that the interferer lacks, from node 5."""
    frame_m = 400.0
    frame_mw = mw(20.0 - free_space_db(frame_m))
    lacks_mw = mw(ENERGY_DBM + over_db) - frame_mw
    assert lacks_mw > 0.0
    power_dbm = 10.0 * np.log10(lacks_mw) + free_space_db(AWAY_M)
    energy = {"preamble_dbm": -40.0, "energy_dbm": ENERGY_DBM}
    radio = jammed(jammer(power_dbm), medium=energy)
    sent = [Sent("5", 0, 1000), Sent("1", 200_000, 100)]
    found = came(radio, sent, **{"5": frame_m})
    [started_ns] = {each.started_ns for each in found if each.node == "1"}
    frame_ns = 20_000 + 4_000 * int(np.ceil((22 + 8 * 1036) / 24))
    assert (started_ns == 200_000 + DIFS_NS) == (over_db < 0.0)
    if over_db > 0.0:
        idle_ns = DIFS_NS + frame_ns + round(frame_m / 299_792_458.0 * 1e9) + DIFS_NS
        assert (started_ns - idle_ns) in [slots * SLOT_NS for slots in range(16)]


def slots_on(run: Run, slot_ns: int, until_ns: int) -> list[tuple[int, int]]:
    """When the only interferer of a run is on: when frames at node 2 have it for noise."""
    world, slots = run.neighbours["a"].network.world, range(0, until_ns, slot_ns)
    return [(at_ns, at_ns + slot_ns) for at_ns in slots if world.noise_mw(1, at_ns) > 2.0 * mw(NOISE_DBM)]


@pytest.mark.slow
def test_a_station_transmits_between_the_pulses_of_an_interferer() -> None:
    """Each packet is on the air DIFS after it entered, or DIFS and a back-off after a pulse that it met."""
    slot_ns = 3 * MS
    radio = jammed(jammer(20.0, duty=0.5, slot_s=0.003))
    sent = [Sent("1", at_ns) for at_ns in range(1 * MS, 3000 * MS, 31_300_001)]
    run = Run({"a": (radio, PLACES)})
    found = run.fates({"a": sent}, 4 * S)["a"]
    assert len(found) == len(sent)
    on = slots_on(run, slot_ns, 4 * S)
    edges = [end for (_, end), (begin, _) in pairwise(on) if begin > end]
    deferred = 0
    for each in found:
        met = [
            (begin, end)
            for begin, end in on
            if begin < each.entered_ns + DIFS_NS - CCA_NS and end > each.entered_ns
        ]
        if met:
            waits_ns = [each.started_ns - edge - DIFS_NS for edge in edges if edge >= met[0][1]]
            assert any(wait_ns in [slots * SLOT_NS for slots in range(16)] for wait_ns in waits_ns)
            deferred += 1
        else:
            assert each.started_ns == each.entered_ns + DIFS_NS
        assert not any(begin + CCA_NS <= each.started_ns < end for begin, end in on)
    assert 0.3 * len(sent) < deferred < 0.7 * len(sent)


RANDOM = {
    "shadowing": {"model": "normal", "sigma_db": 6.0},
    "fading": {"model": "rician", "k_db": 6.0},
}


@pytest.mark.slow
@pytest.mark.parametrize("terms", [{}, RANDOM])
def test_neither_ticks_nor_bystanders_change_who_waits(terms: dict[str, Any]) -> None:
    """With an interferer in pulses near the level of energy; bystanders are beyond reach, and send."""
    power_dbm = ENERGY_DBM + free_space_db(AWAY_M) + 3.0
    radio = (
        jammed(jammer(power_dbm, duty=0.6, slot_s=0.004), jammer(power_dbm, duty=0.3, slot_s=0.007)) | terms
    )
    rng = np.random.default_rng(3)
    sent = [
        Sent(str(rng.choice(["1", "2"])), at_ns, 200) for at_ns in np.sort(rng.integers(0, S, 150)).tolist()
    ]
    first = sorted(map(repr, came(radio, sent, 2 * S)))
    waits_ns = [each.started_ns - each.entered_ns for each in came(radio, sent, 2 * S)]
    assert sum(wait_ns > MS for wait_ns in waits_ns) > 20
    assert waits_ns.count(DIFS_NS) > 20
    for tick_ns in (20 * MS, 200 * MS):
        assert sorted(map(repr, came(radio, sent, 2 * S, tick_ns))) == first
    far = {"8": 5e8, "9": 6e8}
    more = sorted(
        [*sent, *(Sent("8", number * 9 * MS) for number in range(100))], key=lambda each: each.at_ns
    )
    beside = came(radio, more, 2 * S, **far)
    assert sorted(repr(each) for each in beside if {each.node, each.receiver} <= {"1", "2"}) == first


def test_who_has_nothing_to_send_costs_nothing() -> None:
    """After its last back-off nothing is left to happen, though the interferer goes on; without one there never is."""
    for radio in (jammed(jammer(-10.0, duty=0.5)), jammed()):
        run = Run({"a": (radio, PLACES)})
        network = run.neighbours["a"].network
        assert (network.world.sources is None) == (not radio["interference"]["interferers"])
        assert len(run.fates({"a": EVERY_50_MS[:1]}, S)["a"]) == 1
        assert network.access.agenda.next_ns is None


@pytest.mark.parametrize("to", [None, "2"])
def test_a_radio_that_is_off_senses_no_interferer(to: str | None) -> None:
    """What waits for one without end is lost when the radio is next looked at after its switch, 5 ms at most."""
    off_ns = S + 2 * MS
    run = Run({"a": (jammed(jammer(20.0)), PLACES)})
    run.neighbours["a"].side.medium.switch_radio("1", off_ns, on=False)
    sent = [Sent("1", 900 * MS + number * MS, to=to) for number in range(3)]
    found = run.fates({"a": sent}, 2 * S)["a"]
    assert [each.fate for each in found] == ["radio_off"] * 3
    assert all(off_ns < each.arrived_ns <= off_ns + 5 * MS for each in found)
    assert {each.started_ns for each in found} == {-1}


def test_a_radio_that_is_switched_off_leaves_neither_a_back_off_nor_a_window_to_what_follows() -> None:
    """Off in its first try, to one that is off: 34 us of DIFS and 208 of the frame; then the rest is lost at once."""
    run = Run({"a": (jammed(), PLACES)})
    neighbour = run.neighbours["a"]
    neighbour.side.medium.switch_radio("2", 0, on=False)
    neighbour.side.medium.switch_radio("1", 1100_000, on=False)
    sent = [Sent("1", MS, to="2") for _ in range(5)]
    found = run.fates({"a": sent}, S)["a"]
    assert [each.fate for each in found] == ["radio_off"] * 5
    assert [each.started_ns for each in found] == [MS + DIFS_NS, -1, -1, -1, -1]
    # 16 us until an ACK of 44, a slot of grace; DIFS and at most 31 slots of the doubled window
    [lost_ns] = {each.arrived_ns for each in found}
    after_ns = lost_ns - (MS + DIFS_NS + 208_000 + 16_000 + 44_000 + SLOT_NS)
    assert after_ns <= DIFS_NS + 31 * SLOT_NS
    access = neighbour.network.access
    assert isinstance(access, Csma)
    station = access._stations[0]
    assert (station._cw, station._backoff) == (access.timing.cw_min, NO_BACKOFF)


@pytest.mark.slow
@pytest.mark.parametrize(("lbt", "energy_dbm"), [(True, -90.0), (True, -50.0), (False, -90.0)])
def test_a_sik_radio_that_listens_before_it_talks_hears_interferers(lbt: bool, energy_dbm: float) -> None:
    """-60 dBm in slots of 0.2 s: it begins 5 ms after the end of one at the earliest; -50 dBm it never is."""
    medium = {"model": "sik", "lbt": lbt, "energy_dbm": energy_dbm, "preamble_dbm": -95.0, "channels": 1}
    power_dbm = -60.0 + free_space_db(AWAY_M)
    radio = jammed(jammer(power_dbm, duty=0.5, slot_s=0.2)) | {"medium": medium}
    run = Run({"a": (radio, PLACES)})
    found = run.fates({"a": [Sent("1", number * 97 * MS, 50) for number in range(100)]}, 12 * S)["a"]
    on = slots_on(run, 200 * MS, 12 * S)
    within = [any(begin < each.started_ns < end + LBT_NS for begin, end in on) for each in found]
    assert len(found) == 100
    assert (sum(within) == 0) == (lbt and energy_dbm < -60.0)


@pytest.mark.parametrize("over_db", [-0.01, 0.01])
def test_stations_without_a_flight_sense_what_their_links_have_for_noise(over_db: float) -> None:
    """As `lostlink air` loads them."""
    power_dbm = ENERGY_DBM + free_space_db(AWAY_M) + over_db
    radio = Radio(radio_from_mapping(jammed(jammer(power_dbm))))
    world = RadioWorld(radio, {node: (north_m, 0.0, -100.0) for node, north_m in enumerate(PLACES.values())})
    medium = Csma(world, wifi_a(6.0), hearing=Hearing(mw(NOISE_DBM), mw(ENERGY_DBM), cca_ns=CCA_NS))
    medium.offer(AirPacket(0, 0, None, 100, MS))
    assert [one.started_ns for one in medium.run(S) if isinstance(one, AirFate)] == (
        [] if over_db > 0.0 else [MS + DIFS_NS]
    )


@pytest.mark.parametrize("duty", [0.0, 0.5, 1.0])
def test_stations_without_a_flight_sense_only_what_never_pauses(duty: float) -> None:
    """When another is on is not known there, and one that was taken for always on would silence them for good."""
    power_dbm = ENERGY_DBM + free_space_db(AWAY_M) + 10.0
    weak = jammer(power_dbm - 20.0)
    radio = Radio(radio_from_mapping(jammed(jammer(power_dbm, duty=duty), weak)))
    world = RadioWorld(radio, {0: (0.0, 0.0, -100.0), 1: (100.0, 0.0, -100.0)})
    assert world.sources is not None
    sensed_mw = mw(ENERGY_DBM - 10.0) + (mw(ENERGY_DBM + 10.0) if duty == 1.0 else 0.0)
    assert world.sources.powers_mw([0], MS) == pytest.approx([sensed_mw], rel=1e-9)
    medium = Csma(world, wifi_a(6.0), hearing=Hearing(mw(NOISE_DBM), mw(ENERGY_DBM), cca_ns=CCA_NS))
    medium.offer(AirPacket(0, 0, None, 100, MS))
    started_ns = [one.started_ns for one in medium.run(S) if isinstance(one, AirFate)]
    assert started_ns == ([] if duty == 1.0 else [MS + DIFS_NS])


def sources_of(nodes: str, **radio: Any) -> tuple[MediumSources, Medium]:
    """Nodes on their way north at 20 m/s, and a jammer 400 m north of where they begin."""
    there = jammer(20.0) | {"position_ned_m": [400.0, 300.0, -100.0]}
    medium = Medium(Radio(radio_from_mapping(jammed(there) | radio)), seed=7, nodes=nodes)
    return MediumSources(medium, ()), medium


def test_one_node_is_told_what_it_is_among_all() -> None:
    sources, medium = sources_of("abcd", **RANDOM)
    for place, node in enumerate("abcd"):
        medium.place(node, (100.0 * place, 300.0, -100.0))
    medium.switch_radio("b", 10 * MS, on=False)
    for at_ns in (0, 9 * MS, 10 * MS, 12 * MS):
        every = sources.powers_mw(range(4), at_ns)
        assert [power_mw > 0.0 for power_mw in every] == [True, at_ns < 10 * MS, True, True]
        for chosen in ([0], [1], [2, 3], [3, 1]):
            assert sources.powers_mw(chosen, at_ns) == pytest.approx(
                [every[node] for node in chosen], rel=1e-12
            )


def test_powers_are_those_of_the_instant_of_asking_within_a_span() -> None:
    """A fade whose coherence is Doppler's goes on in between, whoever asked before."""
    fading = {"fading": {"model": "rayleigh", "coherence": "doppler"}}
    at_ns = [100 * MS + step * MS for step in range(5)]
    found = []
    for order in (at_ns, at_ns[::-1]):
        sources, medium = sources_of("ab", **fading)
        for now_ns in (0, S):
            medium.observe(medium.nodes, now_ns, [[20.0 * now_ns / S, 300.0, -100.0]] * 2)
        assert {sources.span_ns(each) for each in at_ns} == {(100 * MS, 105 * MS)}
        found.append({each: tuple(sources.powers_mw([0], each)) for each in order})
    assert found[0] == found[1]
    assert len(set(found[0].values())) == 5


@pytest.mark.parametrize("why", ["off", "unknown"])
def test_nothing_is_reckoned_of_who_senses_nothing(why: str) -> None:
    """A law that refuses places beyond its grid, of 1 km, is not asked of a node that is off there, or not seen yet."""
    grid = {"heights_m": [[0.0, 0.0], [0.0, 0.0]], "spacing_m": 1000.0, "origin_north_m": 100.0}
    sources, medium = sources_of("ab", propagation={"model": "terrain", **grid})
    medium.place("a", (500.0, 300.0, -100.0))
    if why == "off":
        medium.place("b", (0.0, 300.0, -100.0))
        medium.switch_radio("b", S, on=False)
        with pytest.raises(OutsideValidityError):
            sources.powers_mw([0, 1], S - 1)
    here_mw, there_mw = sources.powers_mw([0, 1], S)
    assert here_mw > 0.0
    assert there_mw == 0.0
