"""What this machine has of what a run needs."""

from __future__ import annotations

import os
import platform
from importlib import metadata
from pathlib import Path
from typing import Any

from bridge.fleet.autopilots.ardupilot import BINARIES, ArduPilot
from bridge.fleet.autopilots.dirs import AutopilotDirs
from bridge.fleet.autopilots.launcher import AutopilotError
from bridge.fleet.autopilots.px4 import Px4
from bridge.fleet.how import in_words
from bridge.fleet.preflight.ports import conflicts, ports_of
from bridge.record.provenance import px4_version
from bridge.scenario.model import Scenario
from fdm.exchange.px4.watched import why_not_here

PACKAGES = (
    "lostlink",
    "eclipse-zenoh",
    "jsbsim",
    "pymavlink",
    "numpy",
    "scipy",
    "pyarrow",
    "pydantic",
    "matplotlib",
)


def examine(scenario: Scenario, dirs: AutopilotDirs) -> dict[str, Any]:
    """What `doctor` reports, in plain types.

    Args:
        scenario: whose ports to look at.
        dirs: where to look for real autopilots first.
    """
    binaries = _binaries(dirs)
    packages = {name: _version(name) for name in PACKAGES}
    uses = list(ports_of(scenario))
    taken = conflicts(uses)
    return {
        "python": platform.python_version(),
        "platform": platform.platform(),
        "cpu_count": os.cpu_count(),
        "packages": packages,
        "autopilots": {"standin": "ships with lostlink", **binaries},
        "px4_version": px4_version(Path(binaries["px4"])) if binaries["px4"] else "",
        "px4_may_not_repeat": why_not_here(),
        "joined": in_words(scenario),
        "ports": [f"{use}" for use in uses],
        "ports_taken": taken,
        "ok": not taken and None not in packages.values(),
    }


def _version(package: str) -> str | None:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


def _binaries(dirs: AutopilotDirs) -> dict[str, str | None]:
    launcher = ArduPilot(os.environ, dirs)
    found: dict[str, str | None] = {}
    for name in BINARIES.values():
        try:
            found[name] = str(launcher.binary(name))
        except AutopilotError:
            found[name] = None
    try:
        found["px4"] = str(Px4(os.environ, dirs).binary())
    except AutopilotError:
        found["px4"] = None
    return found
