"""A modem that cuts the stream of bytes anywhere, and one that keeps frames whole: from scenario file to record.

The radio loses a known share of its packets, each by itself. A MAVLink frame is lost with any packet that has a part of
it, and frames that share a packet are lost together. So what is independent here is packets: how far the share of lost
frames may be from the reckoned one comes from drawing fates of the packets, not from the number of frames.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import groupby, pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as mav

from bridge.record.tables.deliveries import DELIVERIES
from bridge.record.tables.reader import read_columns
from tests.integration.bridge.mavlink.scripted_station import Said, flown
from tests.integration.bridge.mavlink.test_modem_networks import flown_again

SCENARIO = """schema: 1
name: stream
seed: 11
speed: max
duration_s: {duration_s}
figure: false
origin: {{lat_deg: 47.0, lon_deg: 8.0, alt_amsl_m: 500}}
radio: perfect
networks:
  telemetry: {{preset: sik-433, base_loss: {loss}, bursts: {{model: none}}, medium: {{framing: {framing}}}}}
ports: {{first_slot: {slot}}}
zenoh: false
mcap: {{write: false}}
nodes:
  - {{id: gcs, kind: ground, place: {{east_m: 20}}, modems: {{telemetry: {{serve: [pty]}}}}, agent: {{type: still}}}}
  - {{id: 0, modems: {{telemetry: {{serial: 1}}}}, agent: {{type: still}}}}
"""
DURATION_S, FROM_S, TICKS_PER_S, FRAMES_PER_TICK = 24, 1, 20, 2
LOSS = 0.3
DATA64_BYTES, HEARTBEAT_BYTES = 12 + 66, 12 + 9
"""With header and checksum."""
AROUND_BYTES = 8 + 2 + 2 + 1 + 2 + 2
"""Of a radio packet beside its data: preamble, sync, NETID, length, trailer, CRC."""
OVERHEAD_BYTES = 8
"""That the preset counts to each packet in the record."""
BYTE_NS = 8 * 10**9 // 64_000
DRAWS = 2000


class Packet(NamedTuple):
    """Bytes of the stream from ``begin`` to before ``end``, in one packet of the radio."""

    begin: int
    end: int
    is_lost: bool


def frames() -> Said:
    """3.1 kB a second, of 5.76 that the line carries."""
    ticks = range(FROM_S * TICKS_PER_S, (DURATION_S - 2) * TICKS_PER_S)
    return [
        (tick / TICKS_PER_S, mav.MAVLink_data64_message(1, 64, [1 + tick % 255] * 64))
        for tick in ticks
        for _ in range(FRAMES_PER_TICK)
    ]


def of_the_station(run: Path) -> tuple[NDArray[np.intp], NDArray[np.bool_], NDArray[np.int64]]:
    """Of its frames in their order: lengths, which were lost, and the radio packet that decided (from, until, ns)."""
    names = ("radio", "tx", "seq", "fate", "length_bytes", "started_ns", "ended_ns")
    rows = read_columns(run, DELIVERIES, names)
    own = np.flatnonzero((rows["radio"] == "telemetry") & (rows["tx"] == "gcs"))
    own = own[np.argsort(rows["seq"][own])]
    lengths = rows["length_bytes"][own] - OVERHEAD_BYTES
    assert set(lengths.tolist()) == {DATA64_BYTES, HEARTBEAT_BYTES}, "bytes were dropped"
    packets = np.stack([rows["started_ns"][own], rows["ended_ns"][own]], axis=1)
    return lengths, rows["fate"][own] != "delivered", packets


def radio_packets(
    lengths: NDArray[np.intp], lost: NDArray[np.bool_], packets: NDArray[np.int64]
) -> list[Packet]:
    """Where in the stream each packet of the radio begins and ends; its length is by how long it was on the air.

    The record has those packets that decided what became of a frame. The others had nothing but parts of frames that
    were decided by an earlier or a later one, and are found as gaps.
    """
    ends = np.cumsum(lengths)
    order = sorted(range(len(lengths)), key=lambda frame: (*packets[frame], frame))
    found: list[Packet] = []
    for (from_ns, until_ns), decided in groupby(order, key=lambda frame: tuple(packets[frame])):
        inside = list(decided)
        first, last = inside[0], inside[-1]
        (is_lost,) = set(lost[inside].tolist())
        length_bytes = round((until_ns - from_ns) / BYTE_NS) - AROUND_BYTES
        # A frame that came ends in it, one that it lost has a byte or more in it.
        reaches = ends[last] - lengths[last] + 1 if is_lost else ends[last]
        before = found[-1].end if found else 0
        begin = int(np.clip(before, reaches - length_bytes, ends[first] - 1))
        if begin > before:
            found.append(Packet(before, begin, is_lost=False))
        found.append(Packet(begin, begin + length_bytes, is_lost))
    return found


def reckoned(found: list[Packet], lengths: NDArray[np.intp], is_lost: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Which frames have a part of a lost packet.

    Args:
        found: packets of the radio.
        lengths: of the frames, end to end.
        is_lost: of the packets.
    """
    ends = np.cumsum(lengths)
    first = np.searchsorted([packet.end for packet in found], ends - lengths, side="right")
    after = np.searchsorted([packet.begin for packet in found], ends, side="left")
    lost_before = np.concatenate([[0], np.cumsum(is_lost)])
    return lost_before[after] > lost_before[first]


def shares(lost: NDArray[np.bool_]) -> tuple[float, float]:
    """Of frames that are lost, and of those that are lost and the next one, too."""
    return float(lost.mean()), float((lost[1:] & lost[:-1]).mean())


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("framing", [False, pytest.param(True, marks=pytest.mark.long)])
def test_frames_are_lost_as_packets_are_that_have_a_part_of_them(
    framing: bool, tmp_path: Path, free_slot: Callable[[int], int]
) -> None:
    values = {"duration_s": DURATION_S, "loss": LOSS, "framing": str(framing).lower()}
    run, summary = flown(SCENARIO.format(**values, slot=free_slot(1)), tmp_path, frames())
    lengths, lost, decided = of_the_station(run)
    found = radio_packets(lengths, lost, decided)
    assert all(now.begin == before.end for before, now in pairwise(found))
    assert found[-1].end == lengths.sum(), "all of it was on the air, once"
    packet_lost = np.array([packet.is_lost for packet in found])
    assert np.array_equal(reckoned(found, lengths, packet_lost), lost)
    cut = {packet.end for packet in found} - set(np.cumsum(lengths).tolist())
    assert (not cut) if framing else len(cut) > 0.2 * len(lengths)

    generator = np.random.default_rng(1)
    drawn = [shares(reckoned(found, lengths, generator.random(len(found)) < LOSS)) for _ in range(DRAWS)]
    low, high = np.percentile(drawn, [0.1, 99.9], axis=0)
    assert np.all((low < shares(lost)) & (shares(lost) < high))

    again = flown_again(run, tmp_path, free_slot(1), "many")
    assert again["difference"] is None
    assert again["summary"]["digests"] == summary["digests"]
