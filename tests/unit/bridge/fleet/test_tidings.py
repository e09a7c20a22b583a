"""What the parts of a run say comes to whom it is for, coded or not; what cannot be handled is counted."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from bridge.bus.keys import Keys
from bridge.bus.messages import AgentStatus, AircraftState, Clock, Header, Links, Message, encode
from bridge.fleet.glance import Glance
from bridge.fleet.tidings import SampleSorter

KEYS = Keys("told")
TOLD: list[tuple[str, Message]] = [
    (KEYS.clock, Clock(Header.at(1, ""))),
    (KEYS.clock_pace, Clock(Header.at(2, ""), paused=True)),
    (KEYS.agent("1"), AgentStatus(Header.at(3, ""), "holds")),
    (KEYS.ending, Header.at(4, "half")),
    (KEYS.warning("1"), Header.at(4, "UA 1: look")),
    (KEYS.clock_end, Header.at(5, "")),
]


class Told(SimpleNamespace):
    """Keeps what it is told; a clock later than 10 ns is too much for it."""

    def __init__(self, glance: Glance | None) -> None:
        self.heard: list[Any] = []
        keep = self.heard.append
        super().__init__(glance=glance, pace=keep, end=keep, ending=keep, lost=keep, warning=keep)

    def agent(self, node: str, status: AgentStatus) -> None:
        self.heard.append((node, status))

    def clock(self, clock: Clock) -> None:
        if clock.header.stamp.ns > 10:
            raise ArithmeticError("a mistake of ours")
        self.heard.append(clock)


@pytest.mark.parametrize("coded", [True, False])
def test_each_comes_to_whom_it_is_for(coded: bool) -> None:
    told = Told(Glance())
    sorter = SampleSorter(KEYS, told)
    state, links = AircraftState(Header.at(6, "1"), mode="RTL"), Links(Header.at(7, ""))
    for key, message in [*TOLD, (KEYS.state("1"), state), (KEYS.tick("links"), links)]:
        sorter.take(key, encode(message) if coded else message)
    assert [each if isinstance(each, Message) else each[1] for each in told.heard] == [m for _, m in TOLD]
    assert told.heard[2][0] == "1"
    assert told.glance.states()["1"].mode == "RTL"
    assert told.glance.links()[0] == links
    assert sorter.failed == 0


def test_what_cannot_be_handled_is_counted_and_the_rest_comes(caplog: pytest.LogCaptureFixture) -> None:
    told = Told(None)
    sorter = SampleSorter(KEYS, told)
    for key, came in [(KEYS.clock, Clock(Header.at(11, ""))), (KEYS.clock_end, b"garbage"), TOLD[0]]:
        sorter.take(key, came)
    assert told.heard == [TOLD[0][1]]
    assert sorter.failed == 2
    assert [record.levelname for record in caplog.records] == ["ERROR", "WARNING"]
