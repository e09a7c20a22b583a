"""Parameters of scenario or airframe that an autopilot lacks: PX4 prints them, ArduPilot logs those that it has."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

from aps.logs.dataflash import DataflashError, read_messages
from bridge.record.autopilot_logs import autopilot_logs
from bridge.run.directory import RunDirectory
from bridge.scenario.model import Scenario
from bridge.scenario.nodes import Aircraft
from bridge.scenario.resolve.flight import airframe_of

BEGIN_BYTES = 1 << 20
"""So much of a log is looked at: parameters are set before the first frame, and are the first that ArduPilot logs."""
AFTER_PARAMETERS = "VER"
"""The message that ArduPilot logs when it has logged all parameters."""
_NOT_THERE = re.compile(rb"Parameter (\w+) not found")
_TOLD = {
    "px4": "its PX4 has no parameter {}; nothing was set",
    "ardupilot": "its ArduPilot lists no parameter {}; this version has none, or its group is switched off",
}


def unknown_parameters(scenario: Scenario, run: RunDirectory) -> Iterator[str]:
    """A line for each UA that lacks some. The fleet's count where no other vehicle or autopilot may have them."""
    takers = [ua for ua in scenario.ua if scenario.autopilot_of(ua) in _TOLD]
    lacking = [_lacking(scenario, run, ua) for ua in takers]
    by_kind: dict[tuple[str, str], set[str]] = defaultdict(set)
    for ua, names in zip(takers, lacking, strict=True):
        by_kind[scenario.autopilot_of(ua), airframe_of(ua).vehicle] |= names
    nowhere = set(scenario.parameters).intersection(*by_kind.values())
    for ua, names in zip(takers, lacking, strict=True):
        missing = sorted(names & (nowhere | _own(scenario, ua)))
        if missing:
            yield f"UA {ua.id}: " + _TOLD[scenario.autopilot_of(ua)].format(", ".join(missing))


def _lacking(scenario: Scenario, run: RunDirectory, ua: Aircraft) -> set[str]:
    """Of the parameters that it was given; none where no log says so."""
    names = scenario.parameters.keys() | _own(scenario, ua)
    if not names:
        return set()
    try:
        if scenario.autopilot_of(ua) == "px4":
            return names & _not_there(run.log_path(f"autopilot-{ua.node}"))
        logs = autopilot_logs(run.path).get(ua.node, [])
        return names - _listed(run.path / logs[0]) if logs else set()
    except (OSError, DataflashError, _CutOff):  # removed, or the run was over before it was written
        return set()


def _own(scenario: Scenario, ua: Aircraft) -> set[str]:
    """Names of parameters that are meant for this one's autopilot: its own, and those of its airframe."""
    airframe = airframe_of(ua)
    of_airframe = airframe.ardupilot_parameters
    if scenario.autopilot_of(ua) == "px4":
        of_airframe = airframe.px4.parameters if airframe.px4 else {}
    return ua.parameters.keys() | of_airframe.keys()


class _CutOff(ValueError):
    """A log that ends before all parameters are in it."""


def _not_there(printed: Path) -> set[str]:
    return {name.decode() for name in _NOT_THERE.findall(_begin(printed))}


def _listed(log: Path) -> set[str]:
    begin = _begin(log)
    if not read_messages(begin, AFTER_PARAMETERS):
        raise _CutOff
    names = (message["Name"] for message in read_messages(begin, "PARM"))
    return {name.rstrip(b"\0").decode("ascii", "replace") for name in names if isinstance(name, bytes)}


def _begin(log: Path) -> bytes:
    with log.open("rb") as file:
        return file.read(BEGIN_BYTES)
