"""An autopilot that somebody else runs: it is attached to, never started or ended."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from bridge.fleet.autopilots.launcher import Launcher, LaunchPlan
from bridge.fleet.children.child import ProcessSpec
from bridge.record.provenance import AutopilotOrigin
from bridge.scenario.nodes import Aircraft


class External(Launcher):
    """Listens for MAVLink on the UA's autopilot port, and flies on our flight dynamics."""

    def origin(self, ua: Aircraft) -> AutopilotOrigin:  # noqa: ARG002
        """Not known."""
        return AutopilotOrigin("external")

    def processes(self, plans: Sequence[LaunchPlan]) -> Iterable[ProcessSpec]:  # noqa: ARG002
        """Nothing to start."""
        return ()
