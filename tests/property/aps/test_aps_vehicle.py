"""The machines of missions, parameters and files under arbitrary messages: nothing escapes, nothing grows."""

from __future__ import annotations

from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from aps.vehicle.commander import VERBS, Commander, argument_names
from aps.vehicle.parameters.ftp import MAX_HOLES, ReadExecution, unpacked
from aps.vehicle.parameters.transfer import ListExecution
from aps.wire.framer import Framer
from tests.unit.aps.vehicle.peer import SYSID, Bench

U8, U16, I16 = st.integers(0, 255), st.integers(0, 65_535), st.integers(-32_768, 32_767)
I32, F32 = st.integers(-(2**31), 2**31 - 1), st.floats(width=32)
TARGET = (st.just(SYSID), st.just(191))
NAME = st.binary(max_size=16)
FTP_BODY = st.builds(
    lambda head, offset, data: list(
        (bytes(head) + offset.to_bytes(4, "little") + data).ljust(251, b"\0")[:251]
    ),
    st.tuples(
        U8, U8, st.integers(0, 4), st.sampled_from([128, 129, 3]), U8, st.sampled_from([4, 15, 1, 99]), U8, U8
    ),
    st.integers(0, 3000) | st.integers(0, 2**32 - 1),
    st.binary(max_size=239),
)
MESSAGES = st.one_of(
    st.builds(mavlink.MAVLink_mission_count_message, *TARGET, U16, st.integers(0, 3)),
    st.builds(
        mavlink.MAVLink_mission_request_int_message, *TARGET, st.integers(0, 5) | U16, st.integers(0, 3)
    ),
    st.builds(mavlink.MAVLink_mission_request_message, *TARGET, U16, st.integers(0, 3)),
    st.builds(mavlink.MAVLink_mission_ack_message, *TARGET, st.integers(0, 20), st.integers(0, 3)),
    st.builds(
        mavlink.MAVLink_mission_item_int_message,
        *TARGET,
        st.integers(0, 5) | U16,
        *(U8, U16, U8, U8, F32, F32, F32, F32, I32, I32, F32),
        st.integers(0, 3),
    ),
    st.builds(
        mavlink.MAVLink_param_value_message, NAME, F32, st.integers(0, 12), st.integers(0, 5) | U16, U16
    ),
    st.builds(mavlink.MAVLink_param_error_message, *TARGET, NAME, I16, U8),
    st.builds(mavlink.MAVLink_file_transfer_protocol_message, st.just(0), *TARGET, FTP_BODY),
    st.builds(mavlink.MAVLink_command_ack_message, U16, st.integers(0, 9), U8, st.just(0), *TARGET),
    st.builds(mavlink.MAVLink_mission_current_message, U16, U16, U8, U8),
    st.builds(mavlink.MAVLink_system_time_message, st.integers(0, 2**63), st.integers(0, 2**32 - 1)),
    st.builds(mavlink.MAVLink_heartbeat_message, U8, U8, U8, st.integers(0, 2**32 - 1), U8, U8),
)
ITEM = {"command": 16, "params": [0, 0, 0, 0, 47, 8, 20]}
STARTS = st.sampled_from(
    [
        ("mission_upload", {"items": [ITEM] * 3}),
        ("mission_upload", {"items": [], "kind": "fence"}),
        ("mission_download", {}),
        ("mission_download", {"kind": "rally"}),
        ("mission_clear", {}),
        ("parameters", {}),
        ("parameters", {"ftp": False}),
        ("parameter_get", {"name": "A"}),
        ("parameters_set", {"values": {"A": 1.0, "B": 2.0}}),
        ("message", {"name": "MISSION_COUNT"}),
        ("velocity", {"north_mps": 1.0, "east_mps": 0.0}),
        ("orbit", {"lat_deg": 47.0, "lon_deg": 8.0, "alt_rel_m": 20.0, "radius_m": 30.0}),
        ("mission", {}),
        ("reboot", {}),
    ]
)


@settings(max_examples=40, deadline=None)
@given(st.lists(st.one_of(MESSAGES, STARTS, st.integers(1, 300)), max_size=40))
def test_whatever_the_autopilot_says_commands_end_and_nothing_escapes(steps: list[Any]) -> None:
    bench = Bench()
    started, ended = 0, []
    for step in steps:
        if isinstance(step, int):
            bench.now_ns += step * 100_000_000
            bench.vehicle.on_time(bench.now_ns)
        elif isinstance(step, tuple):
            try:
                bench.commands.start_named(step[0], step[1], on_done=ended.append)
            except ValueError:
                continue  # a mode that this vehicle lacks, say
            started += 1
        else:
            bench.tell(step)
            bench.step()
    bench.commands.interrupt_all("the test is over")
    assert len(ended) == started
    assert not bench.commands.busy


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 2000), st.binary(max_size=239)), max_size=200))
def test_pieces_of_a_file_that_never_fit_are_not_kept_for_ever(pieces: list[tuple[int, bytes]]) -> None:
    read = ReadExecution(Bench().vehicle.telemetry.state(0), "x")
    for offset, data in pieces:
        read._keep(offset + 1, data)
        assert len(read._holes) <= MAX_HOLES


@given(st.binary(max_size=300))
def test_any_bytes_are_packed_parameters_or_refused(content: bytes) -> None:
    for raw in (content, b"\x1b\x67" + content):
        try:
            assert isinstance(unpacked(raw), dict)
        except ValueError:
            continue


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=6,
)


@settings(max_examples=40, deadline=None)
@given(st.sampled_from(sorted(VERBS)), st.data())
def test_any_arguments_from_outside_are_taken_or_refused_with_a_value_error(verb: str, data: Any) -> None:
    names = st.sampled_from([*argument_names(verb), "on_done", "state"])
    arguments = data.draw(st.dictionaries(names, JSON | st.floats(-100.0, 100.0), max_size=8))
    bench = Bench()
    bench.tell(mavlink.MAVLink_heartbeat_message(2, 3, 0xD1, 4, 4, 3))
    try:
        bench.commands.start_named(verb, arguments)
    except ValueError:
        return
    for _ in range(5):
        bench.step()
    assert bench.vehicle.callbacks.errors == 0


@settings(max_examples=30, deadline=None)
@given(st.binary(max_size=2000), st.integers(1, 50))
def test_bytes_of_any_kind_on_the_autopilots_link_leave_the_vehicle_alive(noise: bytes, chunk: int) -> None:
    bench = Bench()
    bench.commands.start("parameters", ftp=False)
    framer = Framer()
    for at in range(0, len(noise), chunk):
        for frame in framer.receive(noise[at : at + chunk]):
            bench.vehicle.receive(frame, bench.now_ns)
    bench.step()
    assert isinstance(bench.commands, Commander)
    assert bench.commands.busy


def test_a_list_that_grows_without_end_is_bounded_by_its_own_numbers() -> None:
    state = Bench().vehicle.telemetry.state(0)
    listing = ListExecution(state)
    for number in range(200_000):
        fields = {
            "param_count": 65_534,
            "param_index": number % 65_534,
            "param_value": 0.0,
            "param_type": 9,
            "param_id": "A",
        }
        listing.on_message("PARAM_VALUE", fields, 0)
        listing.events.clear()
    assert len(listing._found) <= 65_534
