"""An autopilot that somebody else runs: it is attached to, never started or ended."""

from __future__ import annotations

from bridge.fleet.autopilots.launcher import Launcher, LaunchPlan
from bridge.fleet.child import ProcessSpec


class External(Launcher):
    """Listens for MAVLink on the UA's autopilot port, and flies on our flight dynamics."""

    def process(self, plan: LaunchPlan) -> ProcessSpec | None:  # noqa: ARG002
        """Nothing to start."""
        return None
