"""From what a scenario names to the objects of the flight dynamics: airframe, wind, sensor errors, home."""

from __future__ import annotations

from bridge.scenario.model import START_TIME_UNIX_S, Scenario
from bridge.scenario.nodes import Aircraft
from bridge.scenario.sections import Origin
from fdm.air.wind import WindConfig, load_wind, wind_from_mapping
from fdm.exchange.aircraft_spec import LegacyPeer, Px4Peer
from fdm.exchange.hosted_aircraft import Disturb
from fdm.model.airframe import Airframe, load_airframe
from fdm.model.geodesy import GeodeticPosition, Home, geodetic_from_ned
from fdm.model.sensor_noise import SensorNoise
from fdm.wire.legacy import legacy_ports


def airframe_of(ua: Aircraft) -> Airframe:
    """The airframe of a UA.

    Raises:
        AirframeError: there is no such airframe, or its file is wrong.
    """
    return load_airframe(ua.airframe)


def wind_of(scenario: Scenario) -> WindConfig:
    """The wind that a scenario names or spells out.

    Raises:
        WindError: there is no such wind, or its file is wrong.
        ValidationError: it is spelt out, and a key or value is wrong.
    """
    wind = scenario.wind
    return load_wind(wind) if isinstance(wind, str) else wind_from_mapping(wind)


def disturb_of(scenario: Scenario, ua: Aircraft) -> Disturb | None:
    """What adds the errors of a UA's sensors; None if it has none."""
    noise = ua.sensor_noise or scenario.fdm.sensor_noise
    return None if noise == SensorNoise() else noise.disturb(seed=scenario.seed, ua_id=ua.id)


def legacy_of(scenario: Scenario, ua: Aircraft) -> LegacyPeer | None:
    """How a UA whose autopilot speaks the legacy scheme is served; None if it speaks json."""
    if scenario.fdm.scheme != "legacy":
        return None
    return LegacyPeer(legacy_ports(scenario.instance(ua))[0], scenario.fdm.legacy_rate_hz)


def px4_of(scenario: Scenario, ua: Aircraft) -> Px4Peer | None:
    """How a UA that PX4 flies is served; None if another flies it."""
    if scenario.autopilot_of(ua) != "px4":
        return None
    return Px4Peer(scenario.fdm.px4, scenario.seed, START_TIME_UNIX_S, (scenario.autopilot_port(ua),))


def origin_of(origin: Origin) -> GeodeticPosition:
    """The fleet's origin."""
    return GeodeticPosition(origin.lat_deg, origin.lon_deg, origin.alt_amsl_m)


def home_of(ua: Aircraft, origin: Origin) -> Home:
    """Home of a UA on the earth."""
    position = geodetic_from_ned(origin_of(origin), (ua.home.north_m, ua.home.east_m, 0.0))
    return Home(position, ua.home.heading_deg)
