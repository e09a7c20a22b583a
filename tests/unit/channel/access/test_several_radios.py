"""Media of nodes with different radios: frames last at the transmitter's bit rate, and leak by both ends' bands."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from channel.access.media.airtime import AirTime
from channel.access.media.medium import AccessMedium
from channel.access.media.schedule import Schedule, Slot
from channel.access.media.tdma import Tdma
from channel.access.packets import AirFate, AirPacket
from channel.access.settings.air_time import AirTimeMedium
from channel.access.settings.base import Surroundings
from channel.access.settings.medium import rate_mistake
from channel.access.settings.tdma import TdmaMedium
from channel.access.timing import BitRate
from channel.access.world import PlainWorld
from channel.config import RadioConfig
from channel.presets import load_radio

S, MS = 1_000_000_000, 1_000_000
NODES = {"a": 0, "b": 1}
SLOW, FAST = BitRate(8_000.0, header_bytes=10), BitRate(80_000.0, header_bytes=10)
FRAME_NS = {0: 80 * MS, 1: 8 * MS}
"""Of 70 bytes and 10 of header: 640 bits."""
MASK = ((0.5, 0.0), (0.55, -20.0), (1.0, -28.0), (1.5, -40.0), (2.5, -40.0))
"""Offsets in bandwidths and dB, as docs/reference/channel-models.md gives them."""


def lasted_ns(medium: AccessMedium, at_ns: Mapping[int, int]) -> dict[int, int]:
    """How long a packet of 70 bytes of each node is on the air."""
    for node, instant_ns in at_ns.items():
        medium.offer(AirPacket(node, 0, None, 70, instant_ns))
    fates = [each for each in medium.run(2 * S) if isinstance(each, AirFate)]
    return {fate.packet.node: fate.ended_ns - fate.started_ns for fate in fates}


def of_two(**radios: RadioConfig) -> Surroundings:
    return Surroundings.of(PlainWorld((0, 1)), NODES, 1, radios, -110.0)


def radio(**changes: object) -> RadioConfig:
    return load_radio("xbee-900hp", changes)


def test_a_frame_lasts_at_its_transmitters_rate() -> None:
    medium = AirTime(PlainWorld((0, 1)), {0: SLOW, 1: FAST})
    assert lasted_ns(medium, {0: 0, 1: 500 * MS}) == FRAME_NS


def test_in_a_slot_without_a_rate_too_and_in_one_with_it_at_that() -> None:
    own, shared, fixed = (
        Slot((0,), 0, 100 * MS),
        Slot((1, 0), 100 * MS, 100 * MS),
        Slot((0, 1), 0, 100 * MS, bit_rate_bps=64_000.0),
    )
    timing = {0: SLOW, 1: FAST}
    medium = Tdma(PlainWorld((0, 1)), timing, Schedule((own, shared), 200 * MS))
    assert lasted_ns(medium, {0: 150 * MS, 1: 50 * MS}) == FRAME_NS
    medium = Tdma(PlainWorld((0, 1)), timing, Schedule((fixed,), 200 * MS))
    assert lasted_ns(medium, {0: 150 * MS, 1: 350 * MS}) == {0: 10 * MS, 1: 10 * MS}


def test_a_slot_too_short_for_the_slower_of_its_nodes_is_refused() -> None:
    slot = Slot((1, 0), 0, 5 * MS)  # an empty frame takes 10 ms at 8 kb/s, 1 ms at 80
    with pytest.raises(ValueError, match="an empty frame, which takes 10000000 ns"):
        Tdma(PlainWorld((0, 1)), {0: SLOW, 1: FAST}, Schedule((slot,), 10 * MS))


@pytest.mark.parametrize("first", ["slow", "fast"])
def test_settings_open_a_medium_with_each_nodes_rate(first: str) -> None:
    rates_bps = {"slow": 8_000.0, "fast": 80_000.0}
    a_bps, b_bps = rates_bps.pop(first), *rates_bps.values()
    around = of_two(a=radio(bit_rate_bps=a_bps), b=radio(bit_rate_bps=b_bps))
    expected = {0: round(640 / a_bps * S), 1: round(640 / b_bps * S)}
    instants = {0: 0, 1: 500 * MS}
    assert lasted_ns(AirTimeMedium(header_bytes=10).open(around), instants) == expected
    assert lasted_ns(TdmaMedium(slot_s=0.1, header_bytes=10).open(around), instants) == expected
    medium = AirTimeMedium(header_bytes=10, bit_rate_bps=32_000.0).open(around)
    assert lasted_ns(medium, instants) == {0: 20 * MS, 1: 20 * MS}


def test_who_asks_for_the_one_rate_of_several_is_told() -> None:
    around = of_two(a=radio(bit_rate_bps=64e3), b=radio(bit_rate_bps=6.4e3))
    with pytest.raises(
        ValueError, match="one bit rate for all, and node a has 64000 bit/s, node b 6400 bit/s"
    ):
        AirTimeMedium().timing(around)
    assert AirTimeMedium(bit_rate_bps=9600.0).timing(around).bitrate_bps == 9600.0
    assert of_two(a=radio(bit_rate_bps=64e3), b=radio(bit_rate_bps=64e3)).bit_rate_bps == 64e3


@pytest.mark.parametrize(
    ("preset", "medium", "is_told"),
    [
        ("wifi-2.4", {}, True),
        ("telemetry-915", {}, True),
        ("elrs-2.4-333full", {}, True),
        ("xbee-900hp", {"model": "airtime", "bit_rate_bps": 1e4}, True),
        ("xbee-900hp", {"model": "airtime"}, False),
        ("xbee-900hp", {"model": "tdma", "slot_s": 0.1}, False),
        ("lte-uav", {}, False),
        ("moon2020", {}, False),
    ],
)
def test_media_with_a_rate_of_their_own_have_no_radios_of_several(
    preset: str, medium: Mapping[str, object], is_told: bool
) -> None:
    settings = load_radio(preset, {"medium": dict(medium)} if medium else {}).medium
    told = rate_mistake(settings, 64e3, 6.4e3)
    assert ("its bit_rate_bps is 6400 bit/s, that of the first 64000 bit/s" in told) == is_told
    assert rate_mistake(settings, 64e3, 64e3) == ""


def by_grid(offset_hz: float, emitted_hz: float, filter_hz: float) -> float:
    """The share of an emission that passes a filter: sums over a fine grid, to some parts in 10^4."""
    offsets, levels_db = np.array(MASK).T
    f_hz = np.linspace(-2.5 * emitted_hz, 2.5 * emitted_hz, 400_001)
    emitted = 10.0 ** (np.interp(np.abs(f_hz), offsets * emitted_hz, levels_db) / 10.0)
    passed_db = np.interp(np.abs(f_hz + offset_hz), offsets * filter_hz, levels_db)
    return float((emitted * 10.0 ** (passed_db / 10.0)).sum() / emitted.sum())


def test_what_leaks_is_by_the_senders_band_and_the_receivers_filter() -> None:
    widths_hz = {"a": 400e3, "b": 100e3}
    radios = {
        node: radio(bandwidth_hz=width_hz, interference={"rejection": None})
        for node, width_hz in widths_hz.items()
    }
    settings = AirTimeMedium(channels={"a": 0, "b": 2}, channel_spacing_hz=300e3)
    for order in (("a", "b"), ("b", "a")):
        around = of_two(**{node: radios[node] for node in order})
        leaks = settings.hearing(around).adjacent
        for tx in "ab":
            for rx in "ab":
                for channels in (1, 2):
                    expected = by_grid(300e3 * channels, widths_hz[tx], widths_hz[rx])
                    found = leaks.share(NODES[tx], NODES[rx], channels)
                    is_near = 300e3 * channels <= 2.5 * (widths_hz[tx] + widths_hz[rx])
                    assert found == (pytest.approx(expected, rel=1e-3) if is_near else 0.0), (
                        tx,
                        rx,
                        channels,
                    )
