"""What radios measure: of their peers' frames alone, however many links are on the air beside."""

from __future__ import annotations

from collections.abc import Mapping
from math import log10, pi
from typing import Any

import pytest

from bridge.modem.heard import HeardWorld, RadioMeter
from bridge.modem.pair import AIR, GROUND
from bridge.modem.radio_link import LinkPlan, RadioLink
from bridge.modem.settings import counts_foreign, peers_of
from bridge.modem.tracks import apart_over_time
from channel.access import world as access_world
from channel.access.media.medium import AccessMedium
from channel.access.packets import AirPacket
from channel.access.settings.base import Surroundings
from channel.access.settings.elrs import ElrsMedium
from channel.access.settings.sik import SikMedium
from channel.access.world import Disturbed, Foreseeing, Identified, Metering, Switched
from channel.link.radio import Radio
from channel.medium.medium import Medium
from channel.network.link_world import LinkWorld
from channel.presets import load_radio
from tests.unit.bridge.modem.frames import heartbeat

S, MS = 1_000_000_000, 1_000_000
IDS = ("0", "1", "2", "3", "4", "5", "6", "7")
BESIDE_M = 50.0
"""From one link to the next; the two ends of a link are 10 m from each other."""


def measured(preset: str, count: int, settings: Mapping[str, Any], seconds: int = 2) -> dict[int, RadioMeter]:
    """By so many radios, two by two on links of their own that lose nothing to the channel."""
    _, world, access = heard_world(preset, count, settings)
    for tenth in range(10 * seconds):
        for node in range(count):
            access.offer(AirPacket(node, tenth, node ^ 1, 20, tenth * 100 * MS))
    access.run(seconds * S)
    return world.heard


def heard_world(
    preset: str, count: int, settings: Mapping[str, Any]
) -> tuple[LinkWorld, HeardWorld, AccessMedium]:
    lossless = {"error": {"model": "lossless"}, "medium": settings}
    radio, nodes = Radio(load_radio(preset, lossless)), IDS[:count]
    channel = Medium(radio, seed=1, nodes=nodes)
    for number, node in enumerate(nodes):
        channel.place(node, (number // 2 * BESIDE_M, number % 2 * 10.0, -30.0))
    medium = radio.config.medium
    assert isinstance(medium, SikMedium | ElrsMedium)
    floors_dbm = dict.fromkeys(range(count), radio.noise_floor_dbm)
    links, peers = LinkWorld(channel, expects=False, keeps=False), peers_of(medium, nodes)
    world = HeardWorld(links, floors_dbm, peers, counts_foreign=counts_foreign(medium))
    access = medium.open(Surroundings.of(world, channel.index, 1, radio.config, radio.noise_floor_dbm))
    return links, world, access


def test_who_looks_on_at_a_world_is_all_that_the_world_is() -> None:
    """But for frames that are foreseen: what is measured hangs on their order."""
    links, world, _ = heard_world("sik-433", 2, {"model": "sik"})
    optional = [each for each in vars(access_world).values() if getattr(each, "_is_runtime_protocol", False)]
    assert {Identified, Disturbed, Switched, Metering, Foreseeing} <= set(optional)
    assert [each for each in optional if isinstance(links, each) and not isinstance(world, each)] == [
        Foreseeing
    ]


@pytest.mark.slow
def test_link_quality_is_that_of_ones_own_link() -> None:
    """Nothing is lost: each end has heard all that its peer sent, though there is another link."""
    for node, meter in measured("elrs-900-200", 4, {"model": "elrs"}).items():
        assert len(meter.quality) > 50, node
        assert all(meter.quality), node


@pytest.mark.slow
@pytest.mark.parametrize(("ecc", "counts"), [(False, False), (True, True)])
def test_frames_of_another_netid_are_no_packets_and_with_ecc_errors(ecc: bool, counts: bool) -> None:
    """On one channel each hears the other links, 14 dB below the peer (10 m and 50 m), which are no errors.

    With ECC the firmware decodes a frame before it looks at its NETID, and counts what is not its own as an error.
    """
    settings = {"model": "sik", "channels": 1, "ecc": ecc, "capture_db": 6.0}
    alone = measured("sik-433", 2, settings, 4)
    among = measured("sik-433", 8, settings, 4)
    for node in (0, 1):
        assert among[node].frames > 10
        assert alone[node].errors == 0
        assert among[node].rssi == pytest.approx(alone[node].rssi, abs=3)
        assert among[node].remote[0] == pytest.approx(alone[node ^ 1].rssi, abs=3)
    assert (sum(meter.errors for meter in among.values()) > 100) is counts


@pytest.mark.parametrize("jammed", [False, True])
def test_noise_is_what_a_radio_takes_in_though_nothing_comes_through(jammed: bool) -> None:
    """A jammer 100 m north, 20 dBm on the carrier: -45.1 dBm by Friis; register 1.9 (dBm + 127), less what // takes."""
    frequency_hz, way_m, power_dbm = 433.92e6, 100.0, 20.0
    jammer = {"position_ned_m": [way_m, 0.0, -30.0], "power_dbm": power_dbm}
    radio = Radio(
        load_radio(
            "sik-433",
            {
                "frequency_hz": frequency_hz,
                "propagation": {"model": "free-space"},
                "transmit_power_dbm": -20.0,
                "interference": {"interferers": [jammer] if jammed else []},
            },
        )
    )
    link = RadioLink(LinkPlan((radio, radio), apart_over_time([(0.0, 20.0)], (30.0, 30.0))))
    for tenth in range(50):
        link.receive(AIR, heartbeat(), tenth * 100 * MS)
    link.advance(5 * S)
    ground = link.pair.modems[GROUND]
    jam_dbm = power_dbm - 20.0 * log10(4.0 * pi * frequency_hz * way_m / 299_792_458.0)
    expected = 1.9 * ((jam_dbm if jammed else radio.noise_floor_dbm) + 127.0)
    assert expected - 3.0 <= ground.heard.noise <= expected + 1.0
    assert (ground.heard.frames == 0) is jammed
    assert (ground.heard.rssi == 0) is jammed


def test_rssi_goes_to_the_last_frames_power_when_no_more_come() -> None:
    meter = RadioMeter(rssi=150)
    meter.takes(-82.0, 10.0, 0)  # 85.5 by the register: 86
    found = []
    for _ in range(4):
        found.append(meter.rssi)
        meter.heard_nobody()
    assert found == [142, 128, 117, 109]  # (86 + 7 * 150) // 8, then (86 + 3 * 142) // 4 and so on


@pytest.mark.parametrize(
    ("medium", "peers"),
    [
        (SikMedium(units={25: ["0", "1", "3"], 30: ["2", "4"]}), [{1, 3}, {0, 3}, {4}, {0, 1}, {2}]),
        (SikMedium(), [{1}, {0}, {3}, {2}, set()]),
        (ElrsMedium(pairs=(("4", "0"),)), [{4}, set(), set(), set(), {0}]),
    ],
)
def test_whose_frames_a_radio_takes(medium: SikMedium | ElrsMedium, peers: list[set[int]]) -> None:
    assert peers_of(medium, IDS[:5]) == dict(enumerate(peers))
