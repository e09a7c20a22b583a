"""Framer, missions, parameters and files as state machines, driven by hypothesis through any sequence of events.

Each test searches the same way each time. With LOSTLINK_FUZZ_CPU_S it searches anew, for so many seconds of CPU time.
"""

from __future__ import annotations

import gc
import logging
import os
import time
import types
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule, run_state_machine_as_test

from aps.vehicle.execution import Outcome
from aps.vehicle.parameters.ftp import MAX_HOLES, ReadExecution
from aps.wire.framer import MAX_FRAME_BYTES, Framer
from tests.property.aps.test_aps_framer import messages
from tests.property.aps.test_aps_vehicle import MESSAGES, STARTS
from tests.unit.aps.vehicle.peer import SYSID, Bench, KeepingAutopilot, packed

CPU_S = float(os.environ.get("LOSTLINK_FUZZ_CPU_S", "0"))
pytestmark = pytest.mark.timeout(120 + 30 * CPU_S)
SEARCH = settings(
    max_examples=12,
    stateful_step_count=30,
    database=None,
    deadline=None,
    derandomize=CPU_S == 0,
    phases=(Phase.generate, Phase.shrink) if CPU_S else (Phase.generate,),
    suppress_health_check=list(HealthCheck),
)
PARAMETERS = {
    f"{word}_{number}": float(number) for word in ("ACRO", "ATC_RAT", "WPNAV") for number in range(20)
}
ITEMS = st.lists(
    st.builds(
        lambda lat, lon, alt: {"command": 16, "params": [0, 0, 0, 0, lat, lon, alt]},
        st.integers(-80, 80),
        st.integers(-170, 170),
        st.integers(1, 100),
    ),
    min_size=1,
    max_size=12,
)


@pytest.fixture(autouse=True)
def _no_log() -> Iterator[None]:
    """pytest keeps what is logged, and here that is much."""
    logging.disable(logging.CRITICAL)
    yield
    logging.disable(logging.NOTSET)


def search(machine: type[RuleBasedStateMachine]) -> None:
    """Run a machine once, or again and again until the time is up."""
    until_s = time.process_time() + CPU_S
    while True:
        run_state_machine_as_test(machine, settings=SEARCH)
        if time.process_time() >= until_s:
            return


class FramerMachine(RuleBasedStateMachine):
    """One framer gets the stream piece by piece, another one whole: they say the same."""

    def __init__(self) -> None:
        super().__init__()
        self.framer = Framer()
        self.stream = b""
        self.frames: list[bytes] = []

    def feed(self, data: bytes) -> None:
        self.stream += data
        self.frames += [frame.raw for frame in self.framer.receive(data)]

    @rule(raw=messages(), cut=st.integers(0, 300))
    def message_in_two_pieces(self, raw: bytes, cut: int) -> None:
        self.feed(raw[:cut])
        self.feed(raw[cut:])

    @rule(raw=messages(), cut=st.integers(1, 300))
    def message_that_breaks_off(self, raw: bytes, cut: int) -> None:
        self.feed(raw[:-cut])

    @rule(raw=messages(), at=st.integers(0, 300), bits=st.integers(1, 255))
    def message_with_a_wrong_byte(self, raw: bytes, at: int, bits: int) -> None:
        at %= len(raw)
        self.feed(raw[:at] + bytes([raw[at] ^ bits]) + raw[at + 1 :])

    @rule(data=st.binary(max_size=400))
    def garbage(self, data: bytes) -> None:
        self.feed(data)

    @rule(count=st.integers(1, 400), marker=st.sampled_from([0xFD, 0xFE]))
    def markers(self, count: int, marker: int) -> None:
        self.feed(bytes([marker]) * count)

    @invariant()
    def chunking_does_not_matter(self) -> None:
        whole = Framer()
        assert [frame.raw for frame in whole.receive(self.stream)] == self.frames
        assert whole.counters == self.framer.counters
        assert whole.pending_bytes == self.framer.pending_bytes

    @invariant()
    def every_byte_is_accounted_for(self) -> None:
        framer = self.framer
        used = sum(map(len, self.frames))
        assert used + framer.counters.skipped_bytes + framer.pending_bytes == len(self.stream)
        assert framer.pending_bytes <= MAX_FRAME_BYTES


class HostileMachine(RuleBasedStateMachine):
    """Commands under way while the autopilot says anything, and comes and goes."""

    def __init__(self) -> None:
        super().__init__()
        self.bench = Bench(KeepingAutopilot(PARAMETERS))
        self.started = 0
        self.ended: list[Any] = []

    @rule(start=STARTS)
    def command(self, start: tuple[str, dict[str, Any]]) -> None:
        try:
            self.bench.commands.start_named(*start, on_done=self.ended.append)
        except ValueError:
            return  # a mode that this vehicle lacks, say
        self.started += 1

    @rule(said=st.lists(MESSAGES, min_size=1, max_size=5))
    def the_autopilot_says_anything(self, said: list[Any]) -> None:
        for message in said:
            self.bench.tell(message)

    @rule(steps=st.integers(1, 60))
    def the_autopilot_works(self, steps: int) -> None:
        for _ in range(steps):
            self.bench.step()

    @rule(wait_ns=st.integers(0, 40_000_000_000))
    def nothing_happens(self, wait_ns: int) -> None:
        self.bench.now_ns += wait_ns
        self.bench.vehicle.on_time(self.bench.now_ns)

    @rule()
    def the_link_is_lost_and_comes_back(self) -> None:
        self.bench.vehicle.link_down()
        self.bench.step()
        self.bench.vehicle.link_up()

    @invariant()
    def nothing_escapes_and_nothing_grows(self) -> None:
        commands = self.bench.commands
        assert self.bench.vehicle.callbacks.errors == 0
        assert len(self.ended) + len(commands._running) == self.started
        for running in commands._running:
            if isinstance(running.execution, ReadExecution):
                assert len(running.execution._holes) <= MAX_HOLES

    def teardown(self) -> None:
        self.bench.commands.interrupt_all("the test is over")
        assert len(self.ended) == self.started
        assert not self.bench.commands.busy


class LossyMachine(RuleBasedStateMachine):
    """An honest autopilot behind a bad link: what is reached is true."""

    def __init__(self) -> None:
        super().__init__()
        self.autopilot = KeepingAutopilot(PARAMETERS)
        self.bench = Bench(self.autopilot, drop=0.08, corrupt=0.04, seed=5)
        self.uploaded: dict[str, list[Any]] = {}

    def run_to_its_end(self, verb: str, **arguments: Any) -> Any:
        return self.bench.run(verb, **arguments)

    @rule(items=ITEMS, kind=st.sampled_from(["mission", "rally"]))
    def upload(self, items: list[Any], kind: str) -> None:
        if kind == "rally":
            items = [{**item, "command": 5100} for item in items]
        result = self.run_to_its_end("mission_upload", items=items, kind=kind)
        self.uploaded.pop(kind, None)
        if result.reached:
            self.uploaded[kind] = items
            kept = self.autopilot.items[0 if kind == "mission" else 2][kind == "mission" :]
            assert [(item.command, item.x, item.y) for item in kept] == [
                (item["command"], item["params"][4] * 10_000_000, item["params"][5] * 10_000_000)
                for item in items
            ]

    @rule(kind=st.sampled_from(["mission", "rally"]))
    def download(self, kind: str) -> None:
        result = self.run_to_its_end("mission_download", kind=kind)
        if result.reached and kind in self.uploaded:
            came = [(item["command"], *item["params"][4:]) for item in result.value]
            assert came == [(item["command"], *item["params"][4:]) for item in self.uploaded[kind]]

    @rule(kind=st.sampled_from(["mission", "rally"]))
    def clear(self, kind: str) -> None:
        result = self.run_to_its_end("mission_clear", kind=kind)
        self.uploaded.pop(kind, None)
        assert not result.reached or self.autopilot.items[0 if kind == "mission" else 2] == []

    @rule(name=st.sampled_from(sorted(PARAMETERS)), value=st.integers(-1000, 1000))
    def set_a_parameter(self, name: str, value: int) -> None:
        result = self.run_to_its_end("parameter_set", name=name, value=float(value))
        assert result.outcome in (Outcome.REACHED, Outcome.TIMED_OUT)
        assert not result.reached or self.autopilot.parameters[name] == value

    @rule(ftp=st.booleans())
    def fetch_all_parameters(self, ftp: bool) -> None:
        self.autopilot.file = packed(self.autopilot.parameters)
        result = self.run_to_its_end("parameters", ftp=ftp)
        assert not result.reached or result.value == self.autopilot.parameters

    @invariant()
    def nothing_is_left_over(self) -> None:
        assert not self.bench.commands.busy
        assert self.bench.vehicle.callbacks.errors == 0


def test_framer() -> None:
    search(FramerMachine)


def test_machines_of_a_hostile_autopilot() -> None:
    search(HostileMachine)


def test_machines_of_an_honest_autopilot_behind_a_bad_link() -> None:
    search(LossyMachine)


LEAVES = (type, types.ModuleType, types.FunctionType, types.BuiltinFunctionType, types.CodeType)


def reachable(root: object) -> int:
    """How many objects there are because of one, without classes, modules and functions."""
    seen, waiting = {id(root)}, [root]
    while waiting:
        for item in gc.get_referents(waiting.pop()):
            if id(item) not in seen and not isinstance(item, LEAVES):
                seen.add(id(item))
                waiting.append(item)
    return len(seen)


def test_a_vehicle_that_hears_nonsense_for_long_does_not_grow() -> None:
    """One vehicle all the time: frames of the recorded kinds, with random payloads from random components."""
    random = np.random.Generator(np.random.PCG64(11))
    bench, framer = Bench(KeepingAutopilot(PARAMETERS)), Framer()
    ended: list[Outcome] = []
    verbs: list[tuple[str, dict[str, Any]]] = [("parameters", {"ftp": False}), ("parameters", {})]
    verbs += [("mission_download", {}), ("parameter_set", {"name": "ATC_RAT_3", "value": 2.0})]
    kinds = np.array([0, 1, 2, 22, 24, 30, 33, 40, 42, 44, 47, 51, 62, 73, 74, 76, 77, 110, 147, 253, 345])
    sizes: list[int] = []
    begin_s, turn = time.process_time(), 0
    while turn < 400 or time.process_time() - begin_s < CPU_S:
        for kind in random.choice(kinds, 50):
            frame = _nonsense(random, int(kind))
            for one in framer.receive(frame):
                bench.vehicle.receive(one, bench.now_ns)
        verb, arguments = verbs[turn % len(verbs)]
        if not bench.commands.busy:
            bench.commands.start_named(verb, arguments, on_done=lambda result: ended.append(result.outcome))
        bench.now_ns += int(random.integers(5_000_000_000))
        bench.step()
        turn += 1
        if turn % 100 == 0:
            bench.commands.interrupt_all("a look at its size")
            bench.autopilot.heard.clear()
            sizes.append(reachable(bench.vehicle))
    assert bench.vehicle.callbacks.errors == 0
    assert len(ended) > 10
    assert max(sizes) < 1.2 * sizes[0] + 2000, sizes


def _nonsense(random: np.random.Generator, msg_id: int) -> bytes:
    """A MAVLink 2 frame with a good checksum and random bytes, of the autopilot or another component."""
    from fastcrc.crc16 import mcrf4xx

    from aps.wire.dialect import CRC_EXTRA

    payload = random.bytes(int(random.integers(1, 256)))
    if random.random() < 0.5:  # for us
        payload = bytes([SYSID, 191]) + payload[2:] if len(payload) > 2 else payload
    header = bytes(
        [len(payload), 0, 0, int(random.integers(256)), SYSID, 1 if random.random() < 0.9 else 100]
    )
    body = header + msg_id.to_bytes(3, "little") + payload
    return b"\xfd" + body + mcrf4xx(body + CRC_EXTRA[msg_id]).to_bytes(2, "little")
