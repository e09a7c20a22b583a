"""Whether JSBSim takes the airframes that users bring, before a run."""

from __future__ import annotations

from bridge.scenario.model import Scenario
from bridge.scenario.resolve.flight import airframe_of, home_of
from fdm.air.weather import in_weather
from fdm.model.airframe import airframe_names


def load_flight_models(scenario: Scenario) -> None:
    """Load the model of each airframe that does not ship, and let it settle at the first of its homes.

    Raises:
        AirframeError: one cannot be loaded, or does not stand there.
    """
    shipped = airframe_names()
    own = {ua.airframe: ua for ua in reversed(scenario.ua) if ua.airframe not in shipped}
    for ua in own.values():
        from fdm.model.jsbsim_model import JsbsimModel  # late: most scenarios have none

        home = home_of(ua, scenario.origin)
        JsbsimModel(in_weather(airframe_of(ua), scenario.weather, home), home)
