"""Ports of runs: never the same ones twice at a time, and free again when their holder is gone, however it ended."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import psutil
import pytest

from bridge.fleet.course import FleetError
from bridge.fleet.preflight import locks, slots
from bridge.fleet.preflight.slots import FIRST_SLOT, at_free_ports, at_own_or_free_ports, at_own_ports
from bridge.scenario.file import parse_scenario
from bridge.scenario.model import Scenario
from bridge.scenario.sections import Ports

APS = 6765
"""Not where other tests' runs are."""
TEXT = """\
schema: 1
name: still
duration_s: 10
origin: {lat_deg: 40.1331, lon_deg: -105.2404, alt_amsl_m: 1690}
radio: sik-433
ports: {aps: 6765}
nodes:
"""
HOLDER = """
import sys
from bridge.fleet.preflight import slots
from bridge.scenario.model import Scenario
slots.NAME = sys.argv[1]
with slots.at_free_ports(Scenario.from_yaml(sys.argv[2])) as placed:
    print(placed.ports.first_slot, flush=True)
    input()
"""


@pytest.fixture(autouse=True)
def locks_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(slots, "NAME", f"lostlink-{os.getpid()}-{tmp_path.name[:40]}")


def scenario_of(ua: int, more: str = "") -> Scenario:
    nodes = "".join(f"  - {{id: {number}, agent: {{type: still}}}}\n" for number in range(ua))
    return parse_scenario(TEXT + nodes + more, "scenario", Path.cwd(), {})


@contextmanager
def free(ua: int) -> Iterator[int]:
    with at_free_ports(scenario_of(ua)) as placed:
        assert placed.ports.zenoh == 0
        yield placed.ports.first_slot


def test_rows_do_not_meet_and_come_back() -> None:
    with free(3) as first:
        with free(2) as second:
            assert second == first + 3
        with free(4) as third:
            assert third == second
    with free(1) as again:
        assert again == first


def test_a_row_whose_ports_are_taken_is_passed_over() -> None:
    with socket.create_server(("127.0.0.1", APS + 10 * (FIRST_SLOT + 1))), free(2) as slot:
        assert slot == FIRST_SLOT + 2


def test_too_many_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(slots, "LAST_SLOT", FIRST_SLOT + 3)
    with ExitStack() as held:
        held.enter_context(free(3))
        with pytest.raises(FleetError, match=r"no 2 port slots in a row are free between 20 and 23"):
            held.enter_context(free(2))


def test_a_run_whose_own_ports_meet_at_any_slot_is_told_which() -> None:
    scenario = scenario_of(102).model_copy(update={"processes": "many", "ports": Ports()})
    with pytest.raises(FleetError) as told, at_free_ports(scenario):
        pass
    assert str(told.value).splitlines() == [
        f"TCP port {6960 + 10 * ua} (autopilot of UA {100 + ua}) is also wanted for MAVLink server of UA {ua}: change "
        "ports.autopilot in the scenario"
        for ua in range(2)
    ]


@pytest.mark.slow
def test_there_are_slots_for_the_studies_of_a_class() -> None:
    studies, lanes, ua = 20, 8, 2
    with ExitStack() as held:
        assert len({held.enter_context(free(ua)) for _ in range(studies * lanes)}) == studies * lanes


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
def test_real_autopilots_keep_to_instances_that_they_take(
    monkeypatch: pytest.MonkeyPatch, autopilot: str
) -> None:
    monkeypatch.setattr(slots, "FIRST_SLOT", 249)
    scenario = scenario_of(2).model_copy(update={"autopilot": autopilot})
    with pytest.raises(FleetError, match="no 2 port slots"), at_free_ports(scenario):
        pass


@pytest.mark.slow
def test_another_users_run_is_seen_until_it_ends_also_if_it_is_killed(tmp_path: Path) -> None:
    command = [sys.executable, "-c", HOLDER, slots.NAME, scenario_of(3).to_yaml()]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stdin=subprocess.PIPE, env={**os.environ, "TMPDIR": str(tmp_path)}
    ) as holder:
        assert holder.stdout is not None
        held = int(holder.stdout.readline())
        with free(1) as mine:
            assert mine == held + 3
        holder.kill()
        holder.wait()
    with free(1) as mine:
        assert mine == held


def test_ports_of_a_run_that_has_not_bound_them_yet_are_told_as_in_use() -> None:
    with free(2) as slot:
        ports = scenario_of(1).ports.model_copy(update={"first_slot": slot + 1, "zenoh": 0})
        other = scenario_of(1).model_copy(update={"ports": ports})
        with pytest.raises(FleetError) as told, at_own_ports(other):
            pass
    assert str(told.value) == (
        f"TCP port {APS + 10 * (slot + 1)} (MAVLink server of UA 0) is in use by another run: free it, or move all UA "
        "with --first-slot N (auto: to free ports), or change ports.aps in the scenario"
    )
    with at_own_ports(other) as placed:
        assert placed is other


def test_of_a_fleet_whose_ports_are_taken_the_first_are_told_and_how_many_more() -> None:
    scenario = scenario_of(60).model_copy(
        update={"ports": Ports(zenoh=0, aps=APS, first_slot=1500), "api": True}
    )
    api, aps = 8760 + 15000, APS + 15000
    with (
        socket.create_server(("127.0.0.1", api + 10)),
        socket.create_server(("127.0.0.1", api + 50)),
        at_own_ports(scenario.model_copy(update={"api": False})),
        pytest.raises(FleetError) as told,
        at_own_ports(scenario),
    ):
        pass
    who = psutil.Process().name()
    servers = ", ".join(
        f"TCP port {aps + 10 * ua} (MAVLink server of UA {ua}) is in use by another run" for ua in range(3)
    )
    move = "or move all UA with --first-slot N (auto: to free ports), or change"
    assert str(told.value).splitlines() == [
        f"{servers}, and so are 57 more: free them, {move} ports.aps in the scenario",
        *(
            f"TCP port {api + 10 * ua} (HTTP API of UA {ua}) is in use by {who} (pid {os.getpid()}): free it, {move} "
            "ports.api in the scenario"
            for ua in (1, 5)
        ),
    ]


def test_a_port_that_is_an_autopilots_here_and_a_servers_there_is_told_before_either_binds_it() -> None:
    def at(slot: int, **changes: object) -> Scenario:
        scenario = scenario_of(1).model_copy(update=changes)
        return scenario.model_copy(update={"ports": Ports(zenoh=0, first_slot=slot)})

    servers = at(1600)
    with (
        at_own_ports(servers),
        pytest.raises(FleetError, match=r"^TCP port 22760 \(autopilot of UA 0\) is in use by another run: "),
        at_own_ports(at(1700, processes="many")),
    ):
        pass
    with (
        at_own_ports(at(1500, api=True)),
        pytest.raises(
            FleetError, match=r"^TCP port 23760 \(MAVLink server of UA 0\) is in use by another run: "
        ),
        at_own_ports(at(1700)),
    ):
        pass


def test_a_run_that_may_move_does_so_only_if_its_own_ports_are_taken_and_leaves_their_ground_station() -> (
    None
):
    scenario = scenario_of(2)
    scenario = scenario.model_copy(update={"ports": scenario.ports.model_copy(update={"zenoh": 0})})
    with ExitStack() as held:
        placed = [held.enter_context(at_own_or_free_ports(scenario)).ports for _ in range(3)]
    chosen = [(ports.first_slot, ports.gcs) for ports in placed]
    assert chosen == [(0, 14550), (FIRST_SLOT, 0), (FIRST_SLOT + 2, 0)]


def test_a_taken_port_that_does_not_move_with_the_slot_is_told() -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        serve = f'modems: {{main: {{serve: ["tcpin::{port}"]}}}}'
        ground = f"  - {{id: gcs, kind: ground, {serve}, agent: {{type: still}}}}\n"
        with (
            pytest.raises(FleetError, match=rf"^TCP port {port} .*modems.main.serve of node gcs"),
            at_free_ports(scenario_of(1, ground)),
        ):
            pass


def test_where_there_are_no_abstract_sockets_a_lock_is_a_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(locks, "FOLDER", tmp_path)
    with ExitStack() as other:
        with ExitStack() as one:
            assert locks.hold_file("lostlink-1", one)
            assert not locks.hold_file("lostlink-1", other)
            assert locks.hold_file("lostlink-2", other)
        assert locks.hold_file("lostlink-1", other)
