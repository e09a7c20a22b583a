"""Values that wait to be read: the newest few of each name, so much at once, every node in turn."""

from __future__ import annotations

import json

import pytest

from lostlink.view.sources.logged_queue import (
    BYTES_PER_READ,
    BYTES_WAITING_MAX,
    NAMES_WAITING_MAX,
    PAYLOAD_MAX_BYTES,
    VALUES_PER_READ,
    WAITING_MAX,
    LoggedQueue,
    LoggedSample,
)


def sample(node: str, name: str, time_ns: int, payload: bytes = b"1.5") -> LoggedSample:
    return LoggedSample(node, name, time_ns, payload)


def test_values_come_out_in_their_order() -> None:
    queue = LoggedQueue(("0", "1"))
    for time_ns in range(3):
        queue.push(sample("0", "x", time_ns))
    queue.push(sample("1", "y", 9))
    assert [(s.node, s.name, s.sim_time_ns) for s in queue.read()] == [
        ("0", "x", 0),
        ("0", "x", 1),
        ("0", "x", 2),
        ("1", "y", 9),
    ]
    assert queue.read() == []


def test_a_flood_does_not_wash_away_what_is_logged_seldom() -> None:
    queue = LoggedQueue(("0", "1"))
    queue.push(sample("0", "plan", 1))
    queue.push(sample("1", "plan", 1))
    for time_ns in range(100_000):
        queue.push(sample("0", "gap_m", time_ns))
    found = queue.read()
    assert [s.node for s in found if s.name == "plan"] == ["0", "1"]
    assert [s.sim_time_ns for s in found if s.name == "gap_m"] == list(range(100_000 - WAITING_MAX, 100_000))


def everything(queue: LoggedQueue) -> list[LoggedSample]:
    found: list[LoggedSample] = []
    while read := queue.read():
        found += read
    return found


def test_names_that_never_come_again_have_an_end() -> None:
    queue = LoggedQueue(("0", "1"))
    queue.push(sample("1", "x", 0))
    for number in range(10 * NAMES_WAITING_MAX):
        queue.push(sample("0", f"n{number}", number))
    found = everything(queue)
    assert len(found) == NAMES_WAITING_MAX + 1
    assert found[-1].name == f"n{10 * NAMES_WAITING_MAX - 1}"


def test_so_many_bytes_wait() -> None:
    queue = LoggedQueue(("0", "1"))
    queue.push(sample("1", "x", 0))
    for number in range(1000):
        queue.push(sample("0", f"n{number % 500}", number, b" " * PAYLOAD_MAX_BYTES))
    found = everything(queue)
    assert sum(len(s.payload) for s in found if s.node == "0") <= BYTES_WAITING_MAX
    assert len(found) > 100
    assert found[-1].sim_time_ns == 999


def test_so_much_is_read_at_once_and_all_nodes_have_their_turn() -> None:
    nodes = tuple(str(number) for number in range(250))
    queue = LoggedQueue(nodes)
    for node in nodes:
        for name in range(20):
            queue.push(sample(node, f"n{name}", 0))
    reads = [queue.read() for _ in range(10)]
    assert all(len(read) == VALUES_PER_READ for read in reads)
    assert {s.node for s in reads[0]} == set(nodes)
    assert len({(s.node, s.name) for read in reads for s in read}) == 20 * len(nodes)
    assert queue.read() == []
    for node in nodes:
        queue.push(sample(node, "long", 0, b" " * PAYLOAD_MAX_BYTES))
    assert len(queue.read()) == BYTES_PER_READ // PAYLOAD_MAX_BYTES


def test_what_is_too_long_is_told_by_its_length() -> None:
    queue = LoggedQueue(("0",))
    queue.push(sample("0", "x", 0, json.dumps([0.5] * 5000).encode()))
    assert queue.read()[0].value == "25000 bytes, too long to be shown"


def test_what_is_of_nobody_or_has_no_name_of_ours_is_passed_over() -> None:
    queue = LoggedQueue(("0",))
    queue.push(sample("7", "x", 0))
    queue.push(sample("0", "x" * 65, 0))
    assert queue.read() == []


@pytest.mark.parametrize("payload", [b"", b"{", b"\xff\xfe", b"[" * 5000, b"1" * 5000, b"nul"])
def test_what_is_not_json_is_told(payload: bytes) -> None:
    assert sample("0", "x", 0, payload).value.startswith("not JSON: ")
