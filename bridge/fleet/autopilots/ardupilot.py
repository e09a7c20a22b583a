"""Starts real ArduPilot binaries, built by ArduPilot's own documentation and found on this machine."""

from __future__ import annotations

import os
import shutil
import signal
from collections.abc import Iterator, Sequence
from functools import cache
from importlib import resources
from pathlib import Path

from bridge.fleet.autopilots.launcher import AutopilotError, Launcher, LaunchPlan
from bridge.fleet.children.child import ProcessSpec
from bridge.program.standins import serials_of
from bridge.record.provenance import AutopilotOrigin, ardupilot_origin
from bridge.scenario.model import START_TIME_UNIX_S, Scenario
from bridge.scenario.nodes import Aircraft
from bridge.scenario.resolve.flight import airframe_of

HOME_VARIABLE = "ARDUPILOT_HOME"
PARAMETERS = resources.files("sitl_configs") / "params"
BINARIES = {"copter": "arducopter", "plane": "arduplane"}
"""ArduPilot's binary by the airframe's vehicle."""
RC_PORT = 5501
"""Where SITL takes radio control, UDP."""
MAVLINK_2 = 2
FAST_BAUD = 2_000_000
"""SIM_BAUDLIMIT_EN is for all ports: this is faster than what the daemon asks for."""
BAUD_CODES_MAX = 2000
SPEEDUP = 100
"""`--speedup`: with JSON physics it sets no pace, but more than 1 has SITL wait for a slow serial0 client."""


class ArduPilot(Launcher):
    """`arducopter`, `arduplane` and their kin, one process and one working directory per UA."""

    def check(self, scenario: Scenario, ua: Aircraft) -> None:
        """See that the binary for the airframe's vehicle is there.

        Raises:
            AutopilotError: if not, with the places that were looked at.
        """
        del scenario
        vehicle = airframe_of(ua).vehicle
        if vehicle not in BINARIES:
            known = ", ".join(BINARIES)
            raise AutopilotError(f"UA {ua.id}: no ArduPilot is known for a {vehicle}; there are: {known}")
        self.binary(BINARIES[vehicle])

    def origin(self, ua: Aircraft) -> AutopilotOrigin:
        """The binary, by its digest."""
        return _origin_of(self.binary(BINARIES[airframe_of(ua).vehicle]))

    def binary(self, name: str) -> Path:
        """Path of a binary.

        Raises:
            AutopilotError: if it is nowhere.
        """
        places = list(self._places(name))
        for place in places:
            if place.is_file() and os.access(place, os.X_OK):
                return place.resolve()
        on_path = shutil.which(name, path=self.environment.get("PATH"))
        if on_path:
            return Path(on_path).resolve()
        looked = "".join(f"\n  {place}" for place in places)
        vehicle = next(vehicle for vehicle, binary in BINARIES.items() if binary == name)
        or_else = "; or fly the stand-in (autopilot: standin)" if vehicle == "copter" else ""
        raise AutopilotError(
            f"no ArduPilot binary {name!r} was found. Looked at:{looked}\n  {name} on PATH\n"
            f"Build it by ArduPilot's documentation (./waf configure --board sitl && ./waf {vehicle}), then point "
            f"to it with --ardupilot-dir DIR or {HOME_VARIABLE}=DIR{or_else}."
        )

    def _places(self, name: str) -> Iterator[Path]:
        roots = [self.dirs.ardupilot, self.environment.get(HOME_VARIABLE)]
        for root in (Path(r) for r in roots if r):
            yield root / name
            yield root / "bin" / name
            yield root / "build" / "sitl" / "bin" / name

    def processes(self, plans: Sequence[LaunchPlan]) -> Iterator[ProcessSpec]:
        """A process for each UA.

        Raises:
            AutopilotError: there is no binary for one.
        """
        return map(self._process, plans)

    def _process(self, plan: LaunchPlan) -> ProcessSpec:
        """The binary in a working directory of its own below the run's."""
        scenario, ua, vehicle = plan.scenario, plan.ua, plan.airframe.vehicle
        directory = plan.run.path / plan.name
        directory.mkdir()
        # Not "--wipe": SITL keeps that one at a reboot over MAVLink, and so loses what a ground station has set.
        command = [str(self.binary(BINARIES[vehicle])), "-w", "--model", "JSON:127.0.0.1"]
        command += [
            "-I",
            str(ua.id),
            *_ports(scenario, ua),
            "--sysid",
            str(ua.sysid),
            "--home",
            plan.home_text,
        ]
        # by its name alone: SITL splits the list at commas, which the way to a run may have
        command += ["--defaults", f"{PARAMETERS / f'{vehicle}.parm'},{_own_parameters(plan, directory).name}"]
        command += ["--serial0", "tcp:0", "--speedup", str(SPEEDUP), "--start-time", str(START_TIME_UNIX_S)]
        return ProcessSpec(
            plan.name,
            command,
            plan.run.log_path(plan.name),
            cwd=directory,
            stop_signal=signal.SIGKILL,  # SITL ignores SIGTERM while it waits for physics
            environment={"SITL_PANIC_EXIT": "1"},  # a PANIC would else turn in a loop for ever
        )


def _ports(scenario: Scenario, ua: Aircraft) -> Iterator[str]:
    """All by name, and after `-I`, which moves those that are its defaults.

    `-I` itself is in what SITL tells a ground station (banner, AUTOPILOT_VERSION), so it is the UA's, not the ports'.
    """
    fdm_port = scenario.fdm_port(ua)
    yield from ("--base-port", str(scenario.autopilot_port(ua)))
    yield from ("--rc-in-port", str(RC_PORT + 10 * scenario.instance(ua)))
    yield from ("--sim-port-in", str(fdm_port + 1), "--sim-port-out", str(fdm_port))


@cache
def _origin_of(binary: Path) -> AutopilotOrigin:
    return ardupilot_origin(binary)


def _serial_parameters(plan: LaunchPlan) -> dict[str, float]:
    """What makes serial ports with modems as slow as their lines; that of the daemon stays fast."""
    values: dict[str, float] = {}
    for number, _, baud in serials_of(plan.scenario, plan.ua):
        values[f"SERIAL{number}_PROTOCOL"] = MAVLINK_2
        if baud:
            values |= {f"SERIAL{number}_BAUD": _baud_code(baud), "SIM_BAUDLIMIT_EN": 1}
            values["SERIAL0_BAUD"] = FAST_BAUD
    return values


def _baud_code(baud: int) -> int:
    """A rate as SERIALn_BAUD has it: bit/s, or below 2000 in thousands, rounded down."""
    return baud if baud > BAUD_CODES_MAX else baud // 1000


def _own_parameters(plan: LaunchPlan, directory: Path) -> Path:
    """What airframe and scenario set, as a file that ArduPilot reads; the UA's own values win."""
    path = directory / "own.parm"
    values = _serial_parameters(plan) | plan.airframe.ardupilot_parameters
    values |= plan.scenario.parameters | plan.ua.parameters
    lines = [f"{name} {value:.9g}\n" for name, value in values.items()]
    path.write_text("".join(lines), encoding="ascii")
    return path
