"""Where real autopilots were said to be."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, slots=True)
class AutopilotDirs:
    """Directories in which real autopilots are looked for first; None: where their variables or PATH lead.

    Attributes:
        ardupilot: of ArduPilot's binaries, or its checkout.
        px4: PX4's checkout, or the folder of its build.
    """

    ardupilot: Path | None = None
    px4: Path | None = None

    def or_else(self, other: AutopilotDirs) -> AutopilotDirs:
        """These, and those of ``other`` for what was not said."""
        return AutopilotDirs(self.ardupilot or other.ardupilot, self.px4 or other.px4)


NOT_SAID = AutopilotDirs()
