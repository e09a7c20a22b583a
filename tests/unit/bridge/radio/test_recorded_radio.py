"""The radio of a run says in its log what a user may look for, whatever carries it."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from pathlib import Path

import pytest

from bridge.bus.keys import MAIN, Address
from bridge.bus.messages import Header, Quaternion, Truth, Vector3
from bridge.bus.session import Stamp
from bridge.radio.radio import REFUSALS_LOGGED_MAX, RecordedRadio
from bridge.record.events import Report
from bridge.record.packets import packets_of
from bridge.run.directory import RunDirectory
from bridge.scenario.file import parse_scenario, read_scenario

FREE = """
schema: 1
name: free
duration_s: 1
origin: {lat_deg: 40.1331, lon_deg: -105.2404, alt_amsl_m: 1690}
radio: perfect
nodes:
  - {id: 0, agent: {type: still}}
  - {id: probe, kind: ground, agent: {type: free}}
"""
TICK_NS = 50_000_000


@pytest.fixture
def radio(tmp_path: Path) -> Iterator[RecordedRadio]:
    run = RunDirectory.create(tmp_path, "one")
    run.write(read_scenario("separation"), "")
    radio = RecordedRadio(run, Report(run.path, "router"))
    yield radio
    radio.close()


def test_a_switch_by_an_operator_is_logged(radio: RecordedRadio, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO):
        radio.switch("1", 0, on=False)
    assert caplog.messages == ["an operator switched the radio of node 1 off"]


def test_refusals_are_logged_the_first_times(radio: RecordedRadio, caplog: pytest.LogCaptureFixture) -> None:
    for number in range(REFUSALS_LOGGED_MAX + 5):
        radio.packet(Address("0", MAIN, "9", "team"), b"", "", Stamp(number, 0))
    assert len(caplog.messages) == REFUSALS_LOGGED_MAX
    assert caplog.messages[0] == (
        "refused a packet of node 0 to 9 on team; refused so far: 1 unknown_address"
    )


def test_what_free_programs_transmit_is_on_disk_tick_by_tick(tmp_path: Path) -> None:
    """As inputs of hosts are: a run that is killed can be flown again with them."""
    run = RunDirectory.create(tmp_path, "free")
    run.write(parse_scenario(FREE, "free"), "")
    radio = RecordedRadio(run, Report(run.path, "router"))
    ahead_ns = 3 * TICK_NS
    for tick in range(2):
        where = {"position_ned_m": Vector3(0.0, 0.0, -10.0), "attitude": Quaternion()}
        radio.truths([Truth(Header.at(tick * TICK_NS, node), **where) for node in ("0", "probe")])
        radio.tick(tick * TICK_NS)
        for number, at_ns in enumerate((tick * TICK_NS, ahead_ns)[: 2 if tick else 1]):
            radio.packet(Address("probe", MAIN, "all", "team"), b"", "", Stamp(tick + number, at_ns))
        closed = radio.answer("0", tick * TICK_NS)
        assert closed is not None
        radio.write(radio.settle(closed.sim_time_ns).settled)
    found = [(tick_ns, packet.seq, packet.sim_time_ns) for tick_ns, packet in packets_of(run.path, "probe")]
    assert found == [(0, 0, 0), (TICK_NS, 1, TICK_NS), (TICK_NS, 2, ahead_ns)]
    radio.close()
