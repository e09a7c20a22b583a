"""Starts the stand-in autopilot."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence

from bridge.fleet.autopilots.launcher import AutopilotError, Launcher, LaunchPlan
from bridge.fleet.children.child import ProcessSpec
from bridge.fleet.hosts import standin_groups
from bridge.program.standins import frame_parameters, standin_options
from bridge.record.provenance import AutopilotOrigin, standin_origin
from bridge.scenario.model import Scenario
from bridge.scenario.nodes import Aircraft
from bridge.scenario.resolve.flight import airframe_of
from standin.control.mixer import UnknownFrameError, motor_frame


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
            motor_frame(*frame_parameters(airframe).values())
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
            command = [sys.executable, "-P", "-m", "standin", *_options(group[0], has_log=not alone)]
            for plan in group[1:]:
                command += ["+", *_options(plan, has_log=True)]
            yield ProcessSpec(name, command, run.log_path(name))


def _options(plan: LaunchPlan, *, has_log: bool) -> list[str]:
    """One stand-in's. Whoever is alone in its process needs no log besides that of the process."""
    log = ["--log", str(plan.run.log_path(plan.name))] if has_log else []
    return [*standin_options(plan.scenario, plan.ua), *log]
