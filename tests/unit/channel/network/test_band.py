"""Several networks in one band: what the frames of one do to those of another.

Powers, SINR and error rates are written out here: free space, isotropic antennas, thermal noise.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import exp, log10, pi, sqrt
from typing import Any

import numpy as np
import pytest

from channel.access.packets import PLAIN, AirFrame
from channel.access.settings.base import Surroundings
from channel.access.settings.medium import carriers_of
from channel.link.radio import Radio
from channel.medium.medium import Medium
from channel.medium.reception import EVERYBODY, FATES, Packets
from channel.network.band import Neighbour, share_band
from channel.network.crossing import Crossing, NetworkSide
from channel.network.entry import EntryInstants, EntrySettings
from channel.network.network import Network
from channel.presets import load_radio, radio_from_mapping

MS, S = 1_000_000, 1_000_000_000
LIGHT_MPS = 299_792_458.0
FREQUENCY_HZ, BANDWIDTH_HZ, RATE_BPS = 915e6, 130e3, 64e3
POWER_DBM, NOISE_FIGURE_DB = 20.0, 6.0
NOISE_DBM = 10 * log10(1.380649e-23 * 290.0 * BANDWIDTH_HZ) + 30.0 + NOISE_FIGURE_DB
EVERYTHING = {"rejection": [[0.0, 0.0]]}
"""A filter that takes nothing from what comes near: a foreign signal has all its power."""
RADIO: dict[str, Any] = {
    "frequency_hz": FREQUENCY_HZ,
    "bandwidth_hz": BANDWIDTH_HZ,
    "bit_rate_bps": RATE_BPS,
    "transmit_power_dbm": POWER_DBM,
    "antenna": {"model": "isotropic", "gain_db": 0.0},
    "earth_radius_factor": None,
    "propagation": {"model": "free-space"},
    "noise": {"model": "thermal", "noise_figure_db": NOISE_FIGURE_DB},
    "error": {"model": "threshold", "snr_min_db": 10.0},
    "interference": EVERYTHING,
    "medium": {"model": "airtime"},
}
WIFI = RADIO | {"medium": {"model": "csma", "standard": "11a"}}
LONG_MS = 12.5
"""That 100 bytes take."""


def free_space_db(distance_m: float, frequency_hz: float = FREQUENCY_HZ) -> float:
    return 20.0 * log10(4.0 * pi * distance_m * frequency_hz / LIGHT_MPS)


def mw(dbm: float) -> float:
    return 10.0 ** (dbm / 10.0)


def sinr_db(wanted_m: float, *foreign_dbm: float) -> float:
    noise_mw = mw(NOISE_DBM) + sum(mw(each) for each in foreign_dbm)
    return POWER_DBM - free_space_db(wanted_m) - 10.0 * log10(noise_mw)


@dataclass(frozen=True)
class Sent:
    """A packet of a node: when, of how many bytes, and whom for."""

    node: str
    at_ns: int
    length_bytes: int = 100
    to: str | None = None


@dataclass(frozen=True)
class Came:
    """What became of it at one node."""

    node: str
    receiver: str
    entered_ns: int
    started_ns: int
    arrived_ns: int
    fate: str


class Run:
    """Networks of nodes that stand, on the ground level of the drawing: 100 m up, north by name.

    Args:
        networks: by name, the radio of each and how far north its nodes are, m.
    """

    def __init__(
        self, networks: Mapping[str, tuple[Any, Mapping[str, float]]], tick_ns: int = 50 * MS
    ) -> None:
        self.tick_ns = tick_ns
        self.neighbours = {
            name: self._open(name, radio, places) for name, (radio, places) in networks.items()
        }
        self.shares = share_band([*self.neighbours.values()])
        self._numbers = {name: dict.fromkeys(places, 0) for name, (_, places) in networks.items()}

    def _open(self, name: str, radio: Any, places: Mapping[str, float]) -> Neighbour:
        config = load_radio(radio) if isinstance(radio, str) else radio_from_mapping(radio)
        medium = Medium(Radio(config), seed=7, nodes=places, ahead_ns=100 * MS, network=name)
        for node, north_m in places.items():
            medium.place(node, (north_m, 0.0, -100.0))
        floor_dbm = medium.radios[0].noise_floor_dbm
        entry = EntryInstants(tuple(places), EntrySettings(phase_s=0.0), self.tick_ns, medium.draws.common)
        network = Network(
            medium,
            lambda world: config.medium.open(
                Surroundings.of(world, medium.index, medium.draws.seed, config, floor_dbm)
            ),
            entry,
        )
        carriers = carriers_of(config.medium)
        assert carriers is not None
        return Neighbour(network, NetworkSide(name, medium, carriers))

    def fates(self, sent: Mapping[str, Sequence[Sent]], until_ns: int = 2 * S) -> dict[str, list[Came]]:
        """What becomes of packets on each network, tick by tick."""
        came: dict[str, list[Came]] = {name: [] for name in self.neighbours}
        for now_ns in range(0, until_ns, self.tick_ns):
            for name, packets in sent.items():
                due = [each for each in packets if now_ns <= each.at_ns < now_ns + self.tick_ns]
                self._send(name, due)
            for name, neighbour in self.neighbours.items():
                came[name] += self._live(neighbour, now_ns + self.tick_ns)
        return came

    def _send(self, name: str, due: Sequence[Sent]) -> None:
        network, side = self.neighbours[name]
        index = side.medium.index
        for each in due:
            number = self._numbers[name][each.node]
            self._numbers[name][each.node] += 1
            to = EVERYBODY if each.to is None else index[each.to]
            columns = each.at_ns, index[each.node], number, each.length_bytes, to
            network.send(Packets(*(np.array([one]) for one in columns)), [PLAIN])

    @staticmethod
    def _live(neighbour: Neighbour, until_ns: int) -> list[Came]:
        lived, nodes = neighbour.network.live(until_ns), neighbour.side.medium.nodes
        r, instants = lived.receptions, lived.instants
        return [
            Came(
                nodes[r.packets.tx[r.packet[row]]],
                nodes[r.rx[row]],
                int(instants.entered_ns[row]),
                int(instants.started_ns[row]),
                int(instants.arrived_ns[row]),
                FATES[r.fate[row]].value,
            )
            for row in range(r.size)
        ]


def at(came: Sequence[Came], receiver: str) -> list[str]:
    return [each.fate for each in came if each.receiver == receiver]


ONE = {"a": [Sent("1", 0)], "b": [Sent("3", 4 * MS)]}
"""Two frames of 12.5 ms that overlap."""


@pytest.mark.parametrize("foreign_m", [300.0, 310.0, 320.0, 330.0])
def test_a_foreign_frame_is_noise_by_its_power_at_the_receiver(foreign_m: float) -> None:
    """100 m of free space against 316 m: 10 dB, of which the threshold has 10 (noise is 50 dB further down)."""
    run = Run({"a": (RADIO, {"1": 0.0, "2": 100.0}), "b": (RADIO, {"3": 100.0 + foreign_m, "4": 5000.0})})
    ratio_db = sinr_db(100.0, POWER_DBM - free_space_db(foreign_m))
    assert sinr_db(100.0) > 50.0
    assert abs(ratio_db - 10.0) < 0.6
    fates = run.fates(ONE)
    assert at(fates["a"], "2") == ["delivered" if ratio_db >= 10.0 else "interfered"]


def test_what_a_filter_takes_in_of_a_channel_beside_is_the_product_of_two_masks() -> None:
    """By a sum over a fine grid of frequencies of the mask of 802.11, once for the emission and once for the filter."""
    rows = [(0.5, 0.0), (0.55, -20.0), (1.0, -28.0), (1.5, -40.0), (2.5, -40.0)]
    at_hz = np.linspace(-2.5, 2.5, 200_001) * BANDWIDTH_HZ

    def mask(offset_hz: Any) -> Any:
        offsets, levels_db = np.array(rows).T
        return 10.0 ** (np.interp(np.abs(offset_hz) / BANDWIDTH_HZ, offsets, levels_db) / 10.0)

    plain = {key: value for key, value in RADIO.items() if key != "interference"}
    for spacing_hz in (0.0, 65e3, 130e3, 200e3):
        beside = plain | {"frequency_hz": FREQUENCY_HZ + spacing_hz}
        run = Run({"a": (plain, {"1": 0.0, "2": 1.0}), "b": (beside, {"3": 0.0, "4": 1.0})})
        crossing = Crossing(run.neighbours["b"].side, run.neighbours["a"].side)
        share = np.sum(mask(at_hz) * mask(at_hz + spacing_hz)) / np.sum(mask(at_hz))
        assert crossing.share(0, 0, 0, 0) == pytest.approx(share, rel=1e-3)


def test_networks_apart_in_frequency_are_as_if_alone() -> None:
    """2.5 bandwidths of the emission and no row of the filter beyond the carrier: 325 kHz."""
    places = {"1": 0.0, "2": 100.0}, {"3": 110.0, "4": 90.0}
    alone = Run({"a": (RADIO, places[0])}).fates({"a": ONE["a"]})["a"]
    for spacing_hz, fate in ((324e3, "interfered"), (326e3, "delivered")):
        other = RADIO | {"frequency_hz": FREQUENCY_HZ + spacing_hz}
        run = Run({"a": (RADIO, places[0]), "b": (other, places[1])})
        assert run.shares == ([] if spacing_hz > 325e3 else [("a", "b"), ("b", "a")])
        came = run.fates(ONE)["a"]
        assert at(came, "2") == [fate]
        assert (came == alone) == (fate == "delivered")
    worlds = [each.network.world for each in run.neighbours.values()]
    assert [world.beside for world in worlds] == [None, None]


@pytest.mark.slow
def test_noise_is_added_piece_by_piece() -> None:
    """Non-coherent FSK: a foreign frame over the second half of each frame, so strong that half of them are lost."""
    bits, count = 800, 300
    ber = 1.0 - 0.5 ** (1.0 / (bits / 2))
    # BER = exp(-Eb/N0 / 2) / 2, and Eb/N0 = SINR bandwidth / rate
    ratio = -2.0 * np.log(2.0 * ber) * RATE_BPS / BANDWIDTH_HZ
    foreign_m = 100.0 * sqrt(ratio)
    fsk = RADIO | {"error": {"model": "noncoherent-fsk"}}
    expected_ber = 0.5 * exp(
        -0.5 * mw(sinr_db(100.0, POWER_DBM - free_space_db(foreign_m))) * BANDWIDTH_HZ / RATE_BPS
    )
    assert expected_ber == pytest.approx(ber, rel=1e-3)
    run = Run({"a": (fsk, {"1": 0.0, "2": 100.0}), "b": (fsk, {"3": 100.0 + foreign_m, "4": 9000.0})})
    way_ns = round((foreign_m - 100.0) / LIGHT_MPS * 1e9)
    half_ns = round(LONG_MS * MS / 2)
    sent = {
        "a": [Sent("1", k * 50 * MS) for k in range(count)],
        "b": [Sent("3", k * 50 * MS + half_ns - way_ns) for k in range(count)],
    }
    fates = at(run.fates(sent, count * 50 * MS + 50 * MS)["a"], "2")
    assert set(fates) == {"delivered", "interfered"}
    kept = fates.count("delivered") / count
    assert kept == pytest.approx(0.5, abs=4.0 * sqrt(0.25 / count))


@pytest.mark.parametrize(("isolation_db", "fate"), [(107.0, "interfered"), (108.5, "delivered")])
def test_radios_of_one_node_have_an_isolation_between_them(isolation_db: float, fate: str) -> None:
    """Node 2 transmits on the other network, from distance 0, while it receives over 97.7 dB of free space."""
    mine = RADIO | {"interference": EVERYTHING | {"isolation_db": isolation_db}}
    run = Run({"a": (mine, {"1": 0.0, "2": 2000.0}), "b": (RADIO, {"2": 2000.0, "4": 9000.0})})
    assert (sinr_db(2000.0, POWER_DBM - isolation_db) >= 10.0) == (fate == "delivered")
    fates = run.fates({"a": [Sent("1", 0)], "b": [Sent("2", 4 * MS)]})
    assert at(fates["a"], "2") == [fate]


def test_unless_it_is_said_the_isolation_is_25_db() -> None:
    run = Run({"a": (RADIO, {"1": 0.0, "2": 2000.0}), "b": (RADIO, {"2": 2000.0, "4": 9000.0})})
    crossing = Crossing(run.neighbours["b"].side, run.neighbours["a"].side)
    found = {each.receiver: each for each in crossing.reach(AirFrame(0, 0, "data", 100, 0, 12 * MS))}
    assert found[1].power_mw == pytest.approx(mw(POWER_DBM - 25.0))
    assert found[1].delay_ns == 0
    assert found[0].power_mw == pytest.approx(mw(POWER_DBM - free_space_db(2000.0)))
    assert found[0].delay_ns == round(2000.0 / LIGHT_MPS * 1e9)


def test_a_loss_to_the_own_network_is_a_collision_beside_others_too() -> None:
    """Node 5 of the own network is loud; the foreign one alone would not have hurt, or would have."""
    own = {"1": 0.0, "2": 100.0, "5": 200.0}
    for foreign_m, fate in ((2000.0, "collided"), (100.0, "interfered")):
        run = Run({"a": (RADIO, own), "b": (RADIO, {"3": 100.0 + foreign_m, "4": 9000.0})})
        sent = {"a": [Sent("1", 0), Sent("5", 2 * MS)], "b": [Sent("3", 4 * MS)]}
        came = run.fates(sent)["a"]
        assert [each.fate for each in came if (each.node, each.receiver) == ("1", "2")] == [fate]


@pytest.mark.parametrize(("foreign_m", "defers"), [(2000.0, True), (20_000.0, False)])
def test_a_station_senses_the_energy_of_other_networks(foreign_m: float, *, defers: bool) -> None:
    """-62 dBm: free space at 915 MHz leaves 20 dBm that much at 328 m, and -82 dBm at 3.3 km."""
    energy_dbm = -82.0
    wifi = WIFI | {"medium": {"model": "csma", "standard": "11a", "energy_dbm": energy_dbm}}
    run = Run({"a": (wifi, {"1": 0.0, "2": 10.0}), "b": (RADIO, {"3": foreign_m, "4": foreign_m + 10.0})})
    assert (POWER_DBM - free_space_db(foreign_m) >= energy_dbm) == defers
    came = run.fates({"a": [Sent("1", 5 * MS)], "b": [Sent("3", 0)]})["a"]
    [started_ns] = [each.started_ns for each in came if each.receiver == "2"]
    difs_ns, way_ns = 34_000, round(foreign_m / LIGHT_MPS * 1e9)
    if defers:  # then DIFS and a back-off of at most 15 slots of 9 us follow the end of the foreign frame
        end_ns = round(LONG_MS * MS) + way_ns
        assert (started_ns - end_ns - difs_ns) in [9_000 * slots for slots in range(16)]
    else:
        assert started_ns == 5 * MS + difs_ns


def test_a_radio_that_is_off_disturbs_nobody() -> None:
    networks = {"a": (RADIO, {"1": 0.0, "2": 100.0}), "b": (RADIO, {"3": 110.0, "4": 90.0})}
    assert at(Run(networks).fates(ONE)["a"], "2") == ["interfered"]
    run = Run(networks)
    run.neighbours["b"].side.medium.switch_radio("3", 0, on=False)
    assert at(run.fates(ONE)["a"], "2") == ["delivered"]


def busy(seed: int, nodes: Sequence[str], others: Sequence[str]) -> dict[str, list[Sent]]:
    """Two networks under load, at instants of their own."""
    rng = np.random.default_rng(seed)
    sent = {}
    for name, senders in (("a", nodes), ("b", others)):
        instants = np.sort(rng.integers(0, S - 200 * MS, 75)).tolist()
        sent[name] = [Sent(str(rng.choice(senders)), at_ns, int(rng.integers(10, 200))) for at_ns in instants]
    return sent


LOADED: dict[str, tuple[Any, dict[str, float]]] = {
    "a": (WIFI | {"error": {"model": "noncoherent-fsk"}}, {"1": 0.0, "2": 100.0, "5": 300.0}),
    "b": (RADIO | {"error": {"model": "noncoherent-fsk"}}, {"3": 700.0, "4": 90.0, "5": 300.0}),
}


@pytest.mark.slow
def test_neither_ticks_nor_bystanders_change_what_networks_do_to_each_other() -> None:
    sent = busy(1, ("1", "2", "5"), ("3", "4", "5"))
    found = Run(LOADED).fates(sent, S)
    for name in LOADED:
        assert {"delivered", "interfered"} <= {each.fate for each in found[name]}
        assert len(found[name]) == 150
    by_node = [{name: sorted(map(repr, came)) for name, came in found.items()}]
    for tick_ns in (20 * MS, 200 * MS):
        again = Run(LOADED, tick_ns).fates(sent, S)
        by_node.append({name: sorted(map(repr, came)) for name, came in again.items()})
    far = {name: (radio, {**places, "8": 5e6, "9": 6e6}) for name, (radio, places) in LOADED.items()}
    beside = Run(far).fates(sent, S)
    by_node.append(
        {
            name: sorted(repr(each) for each in came if each.receiver not in ("8", "9"))
            for name, came in beside.items()
        }
    )
    assert all(each == by_node[0] for each in by_node)


def test_a_band_has_networks_that_only_a_third_brings_together() -> None:
    """250 kHz apart they hear each other (325 kHz), 500 kHz apart they do not."""
    radios = {f"n{k}": RADIO | {"frequency_hz": FREQUENCY_HZ + k * 250e3} for k in range(3)}
    places = {"1": 0.0, "2": 100.0}
    run = Run({name: (radio, places) for name, radio in radios.items()})
    assert set(run.shares) == {("n0", "n1"), ("n1", "n0"), ("n1", "n2"), ("n2", "n1")}


def test_hops_of_expresslrs_meet_a_wifi_on_a_quarter_of_their_frequencies() -> None:
    """2400.5 to 2479.5 MHz in steps of 1 MHz about the preset's 2440; 802.11 has 2427 to 2447 MHz."""
    places = {"1": 0.0, "2": 100.0}
    run = Run({"a": ("elrs-2.4-333full", places), "b": ("wifi-2.4", places)})
    assert run.shares == [("a", "b"), ("b", "a")]
    a, b = (each.side for each in run.neighbours.values())
    into_wifi = [Crossing(a, b).share(0, channel, 0, 0) for channel in range(80)]
    inside = [abs(2400.5e6 + channel * 1e6 - 2437e6) < 9.6e6 for channel in range(80)]
    assert [share > 0.9 for share in into_wifi] == inside
    assert sum(inside) == 20
    # of the Wi-Fi's 20 MHz a receiver of 812.5 kHz takes in about its own part
    into_elrs = Crossing(b, a).share(0, 0, 0, 36)
    assert into_elrs == pytest.approx(0.8125 / 20.0, rel=0.1)


@pytest.mark.parametrize(("channel", "fate"), [(5, "delivered"), (0, "interfered")])
def test_slots_that_are_all_on_one_channel_are_on_that(channel: int, fate: str) -> None:
    """1 MHz apart, on the radio's own carrier or 5 MHz above: a network of 130 kHz on the carrier meets the former."""
    slots = [{"nodes": "1", "duration_s": 0.05, "channel": channel}]
    medium = {"model": "tdma", "channel_spacing_hz": 1e6, "schedule": {"slots": slots}}
    run = Run(
        {
            "a": (RADIO | {"medium": medium}, {"1": 0.0, "2": 1000.0}),
            "b": (RADIO, {"3": 1100.0, "4": 1200.0}),
        }
    )
    came = run.fates({"a": [Sent("1", 0)], "b": [Sent("3", 4 * MS)]})
    assert at(came["a"], "2") == [fate]


def test_two_sik_networks_meet_on_one_channel_in_fifty() -> None:
    places = {"1": 0.0, "2": 100.0}
    run = Run({"a": ("telemetry-915", places), "b": ("telemetry-915", places)})
    assert run.shares == [("a", "b"), ("b", "a")]
    crossing = Crossing(run.neighbours["a"].side, run.neighbours["b"].side)
    assert crossing.share(0, 7, 0, 7) > 0.8
    # 250 kHz beside it: 31 to 35 dB by the chip's data sheet
    assert -36.0 < 10.0 * log10(crossing.share(0, 7, 0, 8)) < -18.0
