"""The link of two modems on a run's channel: what it keeps, and what its radios measure."""

from __future__ import annotations

import struct
from typing import Any

import pytest

from bridge.modem.pair import AIR, GROUND
from bridge.modem.radio_link import LinkPlan, RadioLink
from bridge.modem.tracks import apart_over_time
from channel.link.radio import Radio
from channel.medium.reception import Fate
from channel.presets import load_radio
from tests.unit.bridge.modem.frames import frame_of, heartbeat

S, MS = 1_000_000_000, 1_000_000
RSSI_AT = 10 + 4
"""In a frame of MAVLink 2: behind its head, rxerrors and fixed."""


def link_of(radio: str, distance_m: float = 20.0, **values: Any) -> RadioLink:
    one = Radio(load_radio(radio, {"error": {"model": "lossless"}, **values}))
    return RadioLink(LinkPlan((one, one), apart_over_time([(0.0, distance_m)], (2.0, 30.0))))


@pytest.mark.slow
@pytest.mark.parametrize("radio", ["sik-433", "elrs-900-200"])
def test_a_link_keeps_no_frame_of_the_past(radio: str) -> None:
    link = link_of(radio)
    for tenth in range(45):
        link.receive(AIR, heartbeat(), tenth * 100 * MS)
        link.advance((tenth + 1) * 100 * MS)
    world = link.pair._medium.world
    assert link.pair.modems[AIR].counts.units_arrived > 30
    assert not list(world._world.first_transmissions())


@pytest.mark.slow
@pytest.mark.parametrize("radio", ["elrs-900-200", pytest.param("elrs-2.4-333full", marks=pytest.mark.long)])
def test_link_quality_of_a_link_without_losses_is_whole(radio: str) -> None:
    """The firmware tells 100 % as 254; a frame that is still on the air is no loss."""
    link = link_of(radio)
    found = set()
    for tenth in range(50):
        link.receive(GROUND, heartbeat(), tenth * 100 * MS)
        for end, (_, data) in link.advance((tenth + 1) * 100 * MS):
            if end == AIR and data[7:10] == struct.pack("<I", 109)[:3] and tenth > 20:
                found.add(data[RSSI_AT])
    assert found == {254}


@pytest.mark.parametrize(
    ("values", "cause"),
    [
        ({"base_loss": 1.0}, Fate.BASE_LOSS),
        ({"max_range_m": 10.0}, Fate.OUT_OF_RANGE),
        ({"bursts": {"model": "gilbert-elliott", "loss_good": 1.0, "loss_bad": 1.0}}, Fate.BURST),
        ({"error": {"model": "noncoherent-fsk"}, "transmit_power_dbm": -100.0}, Fate.CHANNEL_ERASURE),
    ],
)
def test_units_that_the_channel_loses_have_its_cause(values: dict[str, Any], cause: Fate) -> None:
    link = link_of("sik-433", **{"bursts": {"model": "none"}} | values)
    for second in range(5):
        link.receive(GROUND, heartbeat(second), second * S)
    link.advance(6 * S)
    assert link.pair.modems[GROUND].counts.units_lost == {cause: 5}


@pytest.mark.parametrize(("goes_by_messages", "place"), [(True, 1), (False, 10)])
def test_a_heartbeat_goes_before_telemetry_where_queues_go_by_messages(
    goes_by_messages: bool, place: int
) -> None:
    medium = {"model": "airtime", "bit_rate_bps": 9600, "queue": {"mavlink": goes_by_messages}}
    link = link_of("xbee-900hp", medium=medium, bursts={"model": "none"})
    for number in range(10):
        link.receive(AIR, frame_of(60, number), 0)
    link.receive(AIR, heartbeat(), 0)
    came = [data[7:10] == b"\0\0\0" for end, (_, data) in link.advance(10 * S) if end == GROUND]
    assert came.index(True) == place


@pytest.mark.slow
def test_units_in_chunks_that_came_damaged_are_erased() -> None:
    """ExpressLRS repeats frames that are lost; the last frame of a damaged chunk came."""
    link = link_of("elrs-900-200", base_loss=0.4)
    for fifth in range(50):
        link.receive(AIR, frame_of(60, fifth), fifth * 200 * MS)
    link.advance(10 * S)
    assert set(link.pair.modems[AIR].counts.units_lost) == {Fate.CHANNEL_ERASURE}
