"""Starts the stand-in autopilot."""

from __future__ import annotations

import sys

from bridge.autopilots.launcher import AutopilotError, Launcher, LaunchPlan
from bridge.child_process import ProcessSpec
from bridge.resolve import airframe_of
from bridge.scenario import Aircraft, Scenario


class StandIn(Launcher):
    """Our own small autopilot, one process per UA."""

    def check(self, scenario: Scenario, ua: Aircraft) -> None:  # noqa: ARG002
        """See that it can fly the airframe.

        Raises:
            AutopilotError: if not.
        """
        airframe = airframe_of(ua)
        if airframe.vehicle != "copter":
            raise AutopilotError(
                f"UA {ua.id}: the stand-in autopilot flies multirotors only, and {ua.airframe} is a "
                f"{airframe.vehicle}; fly it with --autopilot ardupilot"
            )

    def process(self, plan: LaunchPlan) -> ProcessSpec | None:
        """The stand-in with the UA's ports, home and system id."""
        scenario, ua = plan.scenario, plan.ua
        command = [sys.executable, "-m", "bridge.autopilots.standin"]
        command += ["--sysid", str(ua.sysid), "--home", plan.home_text]
        command += ["--fdm-port", str(scenario.fdm_port(ua))]
        command += ["--mavlink-port", str(scenario.autopilot_port(ua))]
        return ProcessSpec(plan.name, command, plan.run.log_path(plan.name))
