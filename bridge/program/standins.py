"""The stand-ins of a scenario: what each is started with, as a process or to be called."""

from __future__ import annotations

from bridge.scenario.model import Scenario
from bridge.scenario.nodes import Aircraft
from bridge.scenario.resolve.flight import airframe_of, home_of
from fdm.model.airframe import Airframe

FRAME_PARAMETERS = ("FRAME_CLASS", "FRAME_TYPE")
"""What the stand-in takes of an airframe's parameters for ArduPilot: its gains are its own."""


def standin_options(scenario: Scenario, ua: Aircraft) -> list[str]:
    """The command line of one stand-in (`standin.cli`)."""
    home = home_of(ua, scenario.origin)
    place = home.position
    options = ["--sysid", str(ua.sysid), "--name", f"the stand-in of UA {ua.node}"]
    options += [
        "--home",
        f"{place.lat_deg:.9f},{place.lon_deg:.9f},{place.alt_amsl_m:.3f},{home.yaw_deg:.3f}",
    ]
    options += ["--rate-hz", str(scenario.fdm.standin_rate_hz)]
    options += ["--fdm-port", str(scenario.fdm_port(ua)), "--mavlink-port", str(scenario.autopilot_port(ua))]
    for number, port, baud in serials_of(scenario, ua):
        options += ["--serial", f"{number}:{port}:{baud}"]
    for name, value in frame_parameters(airframe_of(ua)).items():
        options += ["--parameter", f"{name}={value:g}"]
    return options


def serials_of(scenario: Scenario, ua: Aircraft) -> list[tuple[int, int, int]]:
    """Of each serial port of a UA's autopilot that has a modem: its number, TCP port and baud rate (0: no line)."""
    if not ua.modems:
        return []
    from bridge.modem.settings import modem_of  # the channel takes its time, and few UA have modems
    from bridge.scenario.resolve.radio import medium_on

    return [
        (
            modem.serial,
            scenario.serial_port(ua, modem.serial),
            modem_of(medium_on(scenario, radio, ua.node), modem.baud).baud,
        )
        for radio, modem in ua.modems.items()
    ]


def frame_parameters(airframe: Airframe) -> dict[str, float]:
    """Which frame it is, as ArduPilot's parameters say it."""
    given = airframe.ardupilot_parameters
    return {name: given.get(name, 1.0) for name in FRAME_PARAMETERS}
