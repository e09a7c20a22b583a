"""Starts the stand-in autopilot."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence

from bridge.fleet.autopilots.launcher import AutopilotError, Launcher, LaunchPlan
from bridge.fleet.child import ProcessSpec
from bridge.fleet.hosts import standin_groups
from bridge.record.provenance import AutopilotOrigin, standin_origin
from bridge.scenario.model import Scenario
from bridge.scenario.nodes import Aircraft
from bridge.scenario.resolve.flight import airframe_of
from fdm.model.airframe import Airframe
from standin.control.mixer import MotorFrame, UnknownFrameError, motor_frame

FRAME_PARAMETERS = ("FRAME_CLASS", "FRAME_TYPE")
"""What the stand-in takes of an airframe's parameters for ArduPilot: its gains are its own."""


class StandIn(Launcher):
    """Our own small autopilot, several in a process."""

    waits_for_physics = True

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

    def processes(self, plans: Sequence[LaunchPlan]) -> Iterator[ProcessSpec]:
        """Processes of several stand-ins; each has its ports, home and log."""
        by_node = {plan.ua.node: plan for plan in plans}
        run = plans[0].run
        for index, nodes in enumerate(standin_groups(plans[0].scenario)):
            group = [by_node[node] for node in nodes]
            alone = len(group) == 1
            name = group[0].name if alone else f"autopilots-{index}"
            command = [sys.executable, "-m", "standin", *_options(group[0], has_log=not alone)]
            for plan in group[1:]:
                command += ["+", *_options(plan, has_log=True)]
            yield ProcessSpec(name, command, run.log_path(name))


def _options(plan: LaunchPlan, *, has_log: bool) -> list[str]:
    """One stand-in's. Whoever is alone in its process needs no log besides that of the process."""
    scenario, ua = plan.scenario, plan.ua
    options = ["--sysid", str(ua.sysid), "--name", f"the stand-in of UA {ua.node}", "--home", plan.home_text]
    options += ["--rate-hz", str(scenario.fdm.standin_rate_hz)]
    options += ["--fdm-port", str(scenario.fdm_port(ua)), "--mavlink-port", str(scenario.autopilot_port(ua))]
    for name, value in _frame(plan.airframe).items():
        options += ["--parameter", f"{name}={value:g}"]
    if has_log:
        options += ["--log", str(plan.run.log_path(plan.name))]
    return options


def _frame(airframe: Airframe) -> dict[str, float]:
    given = airframe.ardupilot_parameters
    return {name: given.get(name, 1.0) for name in FRAME_PARAMETERS}


def _motor_frame(airframe: Airframe) -> MotorFrame:
    return motor_frame(*_frame(airframe).values())
