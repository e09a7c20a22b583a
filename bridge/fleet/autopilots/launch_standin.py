"""Starts the stand-in autopilot."""

from __future__ import annotations

import sys

from bridge.fleet.autopilots.launcher import AutopilotError, Launcher, LaunchPlan
from bridge.fleet.child import ProcessSpec
from bridge.record.provenance import AutopilotOrigin, standin_origin
from bridge.scenario.model import Scenario
from bridge.scenario.nodes import Aircraft
from bridge.scenario.resolve import airframe_of
from bridge.standin.control.mixer import MotorFrame, UnknownFrameError, motor_frame
from fdm.model.airframe import Airframe

FRAME_PARAMETERS = ("FRAME_CLASS", "FRAME_TYPE")
"""What the stand-in takes of an airframe's parameters for ArduPilot: its gains are its own."""


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
        try:
            _motor_frame(airframe)
        except UnknownFrameError as error:
            raise AutopilotError(f"UA {ua.id}: airframe {ua.airframe}: {error}") from error

    def origin(self, ua: Aircraft) -> AutopilotOrigin:  # noqa: ARG002
        """Ours, of this version."""
        return standin_origin()

    def process(self, plan: LaunchPlan) -> ProcessSpec | None:
        """The stand-in with the UA's ports, home and system id."""
        scenario, ua = plan.scenario, plan.ua
        command = [sys.executable, "-m", "bridge.standin"]
        command += ["--sysid", str(ua.sysid), "--home", plan.home_text]
        command += ["--fdm-port", str(scenario.fdm_port(ua))]
        command += ["--mavlink-port", str(scenario.autopilot_port(ua))]
        for name, value in _frame(plan.airframe).items():
            command += ["--parameter", f"{name}={value:g}"]
        return ProcessSpec(plan.name, command, plan.run.log_path(plan.name))


def _frame(airframe: Airframe) -> dict[str, float]:
    given = airframe.ardupilot_parameters
    return {name: given.get(name, 1.0) for name in FRAME_PARAMETERS}


def _motor_frame(airframe: Airframe) -> MotorFrame:
    return motor_frame(*_frame(airframe).values())
