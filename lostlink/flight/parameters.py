"""Parameters of a scenario that an autopilot does not have: PX4 tells in its log, ArduPilot nowhere."""

from __future__ import annotations

import re
from collections.abc import Iterator

from bridge.run.directory import RunDirectory
from bridge.scenario.model import Scenario
from bridge.scenario.nodes import Aircraft

BEGIN_BYTES = 1 << 18
"""So much of a log is looked at: parameters are set before the first frame."""
_NOT_THERE = re.compile(rb"Parameter (\w+) not found")


def unknown_parameters(scenario: Scenario, run: RunDirectory) -> Iterator[str]:
    """A line for each PX4 that lacks some. The fleet's count where all autopilots that take some are PX4."""
    of_all = set() if "ardupilot" in scenario.autopilots else scenario.parameters.keys()
    for ua in scenario.ua:
        if scenario.autopilot_of(ua) != "px4":
            continue
        missing = sorted((of_all | ua.parameters.keys()) & _not_there(run, ua))
        if missing:
            yield f"UA {ua.id}: its PX4 has no parameter {', '.join(missing)}; nothing was set"


def _not_there(run: RunDirectory, ua: Aircraft) -> set[str]:
    try:
        with run.log_path(f"autopilot-{ua.node}").open("rb") as log:
            begin = log.read(BEGIN_BYTES)
    except OSError:  # removed, or of no process of ours
        return set()
    return {name.decode() for name in _NOT_THERE.findall(begin)}
