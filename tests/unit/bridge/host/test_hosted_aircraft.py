"""A UA whose daemon dies ends the run: its clients would wait for ever."""

from __future__ import annotations

import json
from pathlib import Path

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from aps.links.kinds.held_udp import HeldUdpLink
from aps.wire.framer import Framer
from bridge.agents.client import UaClient
from bridge.bus.messages import AgentStatus
from bridge.host.hosted_aircraft import HostedAircraft
from bridge.record.provenance import collect, px4_origin, standin_origin, write_provenance
from bridge.run.directory import RunDirectory
from bridge.scenario.file import read_scenario


class Said:
    """Outlets that keep what is reported."""

    def __init__(self) -> None:
        self.reports: list[AgentStatus] = []
        self.warnings: list[tuple[int, str]] = []

    def report(self, status: AgentStatus) -> None:
        self.reports.append(status)

    def warn(self, text: str, sim_time_ns: int) -> None:
        self.warnings.append((sim_time_ns, text))


async def test_the_death_of_its_daemon_is_reported_as_a_failure(tmp_path: Path) -> None:
    scenario, outlets = read_scenario("separation"), Said()
    run = RunDirectory.create(tmp_path, scenario.name)
    run.write(scenario, "tcp/127.0.0.1:1")
    aircraft = HostedAircraft(run, scenario.ua[0], outlets)  # type: ignore[arg-type]
    aircraft.daemon._failed(LookupError("a defect"))
    (said,) = outlets.reports
    assert said.failed
    assert said.activity == "its aircraft bridge cannot go on: a defect"
    aircraft.close()


async def test_an_autopilot_of_another_system_is_told_at_once(tmp_path: Path) -> None:
    scenario, outlets = read_scenario("separation"), Said()
    run = RunDirectory.create(tmp_path, scenario.name)
    run.write(scenario, "tcp/127.0.0.1:1")
    aircraft = HostedAircraft(run, scenario.ua[0], outlets)  # type: ignore[arg-type]
    aircraft.hold(5, absent=True)
    assert aircraft.daemon.vehicle.on_foreign is not None
    aircraft.daemon.vehicle.on_foreign(9)
    assert outlets.warnings == [
        (5, "UA 0: its autopilot calls itself system 9: nothing that it says is taken")
    ]
    aircraft.close()


async def test_the_gravest_warning_of_its_autopilot_is_for_its_agent(tmp_path: Path) -> None:
    scenario, outlets = read_scenario("separation"), Said()
    run = RunDirectory.create(tmp_path, scenario.name)
    run.write(scenario, "tcp/127.0.0.1:1")
    aircraft = HostedAircraft(run, scenario.ua[0], outlets)  # type: ignore[arg-type]
    texts = (
        (3, "PreArm: GPS 1: Bad fix"),
        (3, "Found 1 compass (required: 3)"),
        (4, "No connection to the ground control station"),
        (6, "AHRS: active"),
    )
    mav, vehicle = (
        mavlink.MAVLink(None, srcSystem=scenario.ua[0].sysid, srcComponent=1),
        aircraft.daemon.vehicle,
    )
    for severity, text in texts:
        packed = mavlink.MAVLink_statustext_message(severity, text.encode()).pack(mav)
        for frame in Framer().receive(bytes(packed)):
            vehicle.receive(frame, 0)
    ua = UaClient("0", outlets)  # type: ignore[arg-type]
    for arrival in aircraft.node.arrivals.take():
        arrival(ua)
    assert ua.warning == "Found 1 compass (required: 3)", "of the gravest the newest"
    aircraft.close()


async def test_its_tlog_is_written_with_its_record_and_counted_whole(tmp_path: Path) -> None:
    scenario = read_scenario("separation")
    run = RunDirectory.create(tmp_path, scenario.name)
    run.write(scenario, "tcp/127.0.0.1:1")
    aircraft = HostedAircraft(run, scenario.ua[0], Said())  # type: ignore[arg-type]
    frame = bytes(mavlink.MAVLink_heartbeat_message(2, 3, 81, 0, 3, 3).pack(mavlink.MAVLink(None, 1, 1)))
    tlog = aircraft.daemon.tlog
    assert tlog is not None
    tlog.write(frame)
    assert not tlog.paths, "it waits"
    aircraft.flush_record()
    assert tlog.paths[0].read_bytes()[8:] == frame
    tlog.write(frame)
    aircraft.close()
    counters = json.loads((run.path / "reports" / "node-0.json").read_text())["counters"]
    assert (counters["mavlink.tlog.frames"], tlog.paths[0].stat().st_size) == (2, 2 * (8 + len(frame)))
    tlog.close()


async def test_its_daemon_knows_the_events_of_the_px4_that_was_started(
    tmp_path: Path, px4_home: Path
) -> None:
    scenario = read_scenario("separation", {"nodes.1.autopilot": "px4"})
    run = RunDirectory.create(tmp_path, scenario.name)
    run.write(scenario, "tcp/127.0.0.1:1")
    binary = px4_home / "build" / "px4_sitl_default" / "bin" / "px4"
    write_provenance(collect({"0": standin_origin(), "1": px4_origin(binary)}), run.path)
    first, second = (HostedAircraft(run, ua, Said()) for ua in scenario.ua)  # type: ignore[arg-type]
    assert [each.daemon.vehicle.events.known for each in (first, second)] == [False, True]
    assert str(first.daemon.link.address) == "tcp:127.0.0.1:5760"
    assert str(second.daemon.link.address) == "udp-in:127.0.0.1:5771", "the next after its own, 5760 + 10"
    assert isinstance(second.daemon.link, HeldUdpLink)
    assert second.daemon.link.known_peer == ("127.0.0.1", 5770)
    for each in (first, second):
        each.close()
