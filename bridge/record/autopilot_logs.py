"""Logs that autopilots have kept in a run's directory: ULog of PX4, dataflash of ArduPilot."""

from __future__ import annotations

from pathlib import Path

FOLDER = "autopilot-"
"""Before a UA's id: the working directory of its autopilot."""
PATTERNS = ("log/*/*.ulg", "logs/*.BIN")
"""Where PX4 and ArduPilot write them."""


def autopilot_logs(run: Path) -> dict[str, list[str]]:
    """By node id, paths in the run's directory; nodes whose autopilot keeps none are not in it."""
    logs = {
        folder.name.removeprefix(FOLDER): sorted(
            log.relative_to(run).as_posix() for pattern in PATTERNS for log in folder.glob(pattern)
        )
        for folder in sorted(run.glob(f"{FOLDER}*/"))
    }
    return {node: paths for node, paths in logs.items() if paths}
