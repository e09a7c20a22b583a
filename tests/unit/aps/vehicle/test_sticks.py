"""The throttle stick in the middle: when it is held, how often, and who ends it."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from aps.vehicle.sticks import MiddleStick
from aps.wire.framer import Framer


class Bench:
    """A stick, and what it says."""

    def __init__(self) -> None:
        self.said: list[Any] = []
        self._parser = mavlink.MAVLink(None)
        self.stick = MiddleStick(4, lambda raw: self.said.extend(self._parser.parse_buffer(raw) or []))

    def throttles_us(self) -> list[int]:
        said, self.said[:] = list(self.said), []
        return [message.chan3_raw for message in said]

    def fly(self, mode: str, from_ms: int, to_ms: int, *, armed: bool = True) -> list[int]:
        for clock_ms in range(from_ms, to_ms, 50):
            self.stick.state_changed(mode, armed, clock_ms)
        return self.throttles_us()


@pytest.fixture
def bench() -> Bench:
    bench = Bench()
    bench.fly("GUIDED", 0, 1000)
    return bench


def test_it_is_held_from_the_command_on_by_the_autopilots_clock(bench: Bench) -> None:
    bench.stick.flight_begins("LOITER")
    (first,) = bench.said
    assert (first.get_srcSystem(), first.target_system, first.chan3_raw) == (255, 4, 1500)
    assert {first.chan1_raw, first.chan2_raw, first.chan4_raw, first.chan8_raw} == {65535}
    bench.throttles_us()
    assert bench.fly("LOITER", 1000, 3000) == [1500] * 10
    assert bench.fly("LOITER", 0, 1000) == [1500] * 5, "a clock that begins anew"


def test_any_other_flight_lets_go(bench: Bench) -> None:
    assert bench.fly("GUIDED", 0, 1000) == []
    bench.stick.flight_begins("LOITER")
    bench.stick.flight_begins("")
    assert bench.throttles_us() == [1500, 0]
    assert bench.fly("LOITER", 1000, 2000) == []


def test_a_mode_that_somebody_else_chose_lets_go(bench: Bench) -> None:
    bench.stick.flight_begins("LOITER")
    bench.fly("GUIDED", 1000, 1100)
    bench.fly("LOITER", 1100, 1500)
    assert bench.fly("RTL", 1500, 2000) == [0]
    assert bench.fly("LOITER", 2000, 3000) == [], "nor does it begin again of itself"


def test_a_pilot_has_the_sticks(bench: Bench) -> None:
    bench.stick.flight_begins("LOITER")
    bench.throttles_us()
    client = mavlink.MAVLink(None, srcSystem=255)
    (frame,) = Framer().receive(mavlink.MAVLink_manual_control_message(4, 0, 0, 700, 0, 0).pack(client))
    bench.stick.client_frame(frame)
    assert bench.fly("LOITER", 1000, 3000) == []


def test_it_is_not_held_on_the_ground_as_arming_is_refused_with_it(bench: Bench) -> None:
    bench.fly("GUIDED", 1000, 1100, armed=False)
    bench.stick.flight_begins("LOITER")
    assert bench.fly("LOITER", 1100, 2000, armed=False) == []
    assert bench.fly("LOITER", 2000, 2400) == [1500, 1500]
    assert bench.fly("LOITER", 2400, 3000, armed=False) == [0]
