"""Starts the stand-in autopilot."""

from __future__ import annotations

import sys

from bridge.autopilots.launcher import Launcher, LaunchPlan
from bridge.child_process import ProcessSpec


class StandIn(Launcher):
    """Our own small autopilot, one process per UA."""

    def process(self, plan: LaunchPlan) -> ProcessSpec | None:
        """The stand-in with the UA's ports, home and system id."""
        scenario, ua = plan.scenario, plan.ua
        command = [sys.executable, "-m", "bridge.autopilots.standin"]
        command += ["--sysid", str(ua.sysid), "--home", plan.home_text]
        command += ["--fdm-port", str(scenario.fdm_port(ua))]
        command += ["--mavlink-port", str(scenario.autopilot_port(ua))]
        return ProcessSpec(plan.name, command, plan.run.log_path(plan.name))
