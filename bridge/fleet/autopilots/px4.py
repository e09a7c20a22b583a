"""Starts a real PX4, built by PX4's own documentation and found on this machine."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path

from bridge.fleet.autopilots.launcher import AutopilotError, Launcher, LaunchPlan
from bridge.fleet.children.child import ProcessSpec
from bridge.record.provenance import AutopilotOrigin, px4_origin
from bridge.run.px4 import HOME_VARIABLE, etc_of, find_px4, px4_places, whole_parameters
from bridge.scenario.model import Scenario
from bridge.scenario.nodes import Aircraft
from bridge.scenario.resolve.flight import airframe_of

INSTANCE_MAX = 249
RATE_BYTES_PER_S = 4_000_000
PARAMETERS = {
    "COM_RC_IN_MODE": 1,
    "COM_OBL_RC_ACT": 5,
    "NAV_DLL_ACT": 0,
    "NAV_RCL_ACT": 0,
}
"""Sticks come by MAVLink, if at all, and neither they nor a ground station are missed; where setpoints end, it holds.

With COM_RC_IN_MODE 4, no sticks, a PX4 of 2026 without a ground station takes a mission that it begins in the air for
one that is over, and returns.
"""


class Px4(Launcher):
    """PX4 SITL, one process and one working directory per UA, where its log (ULog) is kept."""

    def check(self, scenario: Scenario, ua: Aircraft) -> None:
        """See that PX4 is there, and can fly the airframe at the UA's ports.

        Raises:
            AutopilotError: if not, with the places that were looked at.
        """
        px4 = airframe_of(ua).px4
        if px4 is None:
            raise AutopilotError(
                f"UA {ua.id}: airframe {ua.airframe} has no section px4: PX4 cannot fly it "
                "(docs/how-to/px4.md shows how to write one)"
            )
        binary = self.binary()
        if scenario.instance(ua) > INSTANCE_MAX:
            raise AutopilotError(
                f"UA {ua.id} would be PX4's instance {scenario.instance(ua)}, beyond {INSTANCE_MAX}, where ports of "
                "others begin: lower ports.first_slot (--first-slot)"
            )
        values = px4.parameters | scenario.parameters | ua.parameters
        fractions = {name: value for name, value in values.items() if value % 1}
        for name in sorted(fractions.keys() & whole_parameters(binary) if fractions else ()):
            raise AutopilotError(
                f"UA {ua.id}: parameter {name} is {fractions[name]:g}, and of PX4 a whole number: it would be "
                f"{int(fractions[name])}"
            )

    def origin(self, ua: Aircraft) -> AutopilotOrigin:  # noqa: ARG002
        """The binary, by its digest."""
        return _origin_of(self.binary())

    def binary(self) -> Path:
        """Path of ``px4``; beside its folder lies ``etc``, with PX4's start scripts.

        Raises:
            AutopilotError: if it is nowhere.
        """
        found = find_px4(self.environment, self.dirs.px4)
        if found is not None:
            return found
        looked = "".join(f"\n  {place}" for place in px4_places(self.environment, self.dirs.px4))
        raise AutopilotError(
            f"no PX4 was found. Looked at:{looked}\n  px4 on PATH\n"
            "Build it by PX4's documentation (make px4_sitl_default), then point to it with --px4-dir DIR or "
            f"{HOME_VARIABLE}=DIR; or fly the stand-in (autopilot: standin)."
        )

    def processes(self, plans: Sequence[LaunchPlan]) -> Iterator[ProcessSpec]:
        """A process for each UA.

        Raises:
            AutopilotError: there is no PX4.
        """
        return map(self._process, plans)

    def _process(self, plan: LaunchPlan) -> ProcessSpec:
        """PX4 in a working directory of its own below the run's, in which its start script finds ours first."""
        binary, directory = self.binary(), plan.run.path / plan.name
        directory.mkdir()
        values = _own_parameters(plan)
        script = "".join(f"param set {name} {value}\n" for name, value in values.items())
        (directory / "px4-rc.params").write_text(script, encoding="ascii")
        (directory / "px4-rc.mavlink").write_text(_own_mavlink(plan), encoding="ascii")
        command = [str(binary), "-i", str(plan.scenario.instance(plan.ua))]
        command += ["-d", str(etc_of(binary)), "-w", str(directory), "-s", "etc/init.d-posix/rcS"]
        px4 = plan.airframe.px4
        return ProcessSpec(
            plan.name,
            command,
            plan.run.log_path(plan.name),
            cwd=directory,
            stop_signal=signal.SIGKILL,  # held in lockstep, it never comes to obey another
            environment={
                "PX4_SYS_AUTOSTART": str(px4.autostart if px4 else 0),
                **{f"PX4_PARAM_{name}": value for name, value in values.items()},
                "PATH": os.pathsep.join((str(directory), self.environment.get("PATH", os.defpath))),
            },
        )


@cache
def _origin_of(binary: Path) -> AutopilotOrigin:
    return px4_origin(binary)


def _own_parameters(plan: LaunchPlan) -> dict[str, str]:
    """What airframe and scenario set, as PX4's shell reads it; the UA's own values win.

    PX4 before 25 March 2025 takes them from `px4-rc.params`, PX4 since 4 April 2025 from PX4_PARAM_*.
    """
    values: dict[str, float] = {"MAV_SYS_ID": plan.ua.sysid, **PARAMETERS}
    values |= plan.airframe.px4.parameters if plan.airframe.px4 else {}
    values |= plan.scenario.parameters | plan.ua.parameters
    return {name: _number(value) for name, value in values.items()}


def _number(value: float) -> str:
    """As PX4's shell reads it: of a whole number it takes digits alone, up to the first other character."""
    return str(int(value)) if value == int(value) else f"{value:.9g}"


def _own_mavlink(plan: LaunchPlan) -> str:
    """One MAVLink link, to the UA's daemon, and nothing on it that depends on this machine: its time, its load.

    The load monitor is stopped at its first look, at 0.5 s: what was a frame late before then goes on at one instant.
    It has to have told the load once, else missions are refused.
    """
    port = plan.scenario.autopilot_port(plan.ua)
    return (
        f"mavlink start -x -u {port} -o {port + 1} -t 127.0.0.1 -r {RATE_BYTES_PER_S} -m onboard\n"
        f"mavlink stream -r 0 -s SYSTEM_TIME -u {port}\n"
        "load_mon stop\n"
    )
