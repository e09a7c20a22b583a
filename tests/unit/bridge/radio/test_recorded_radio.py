"""The radio of a run says in its log what a user may look for, whatever carries it."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from pathlib import Path

import pytest

from bridge.bus.keys import MAIN, Address
from bridge.bus.session import Stamp
from bridge.radio.radio import REFUSALS_LOGGED_MAX, RecordedRadio
from bridge.record.events import Report
from bridge.run.directory import RunDirectory
from bridge.scenario.file import read_scenario


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
        "refused a packet of node 0 to 9 on team; refused so far: {<Refused.UNKNOWN_ADDRESS: 'unknown_address'>: 1}"
    )
