"""Takes off and holds."""

from __future__ import annotations

from bridge.agents.shipped.yielding import Yielding
from bridge.scenario.agents import HoldAgent


class Hold(Yielding):
    """Climbs to the configured altitude and stays there; others decide when the run is over."""

    async def mission(self) -> None:
        """Take off; GUIDED then holds by itself."""
        config = self.config.agent
        assert isinstance(config, HoldAgent)
        await self.take_off(config.altitude_m)
        self.ua.report(f"holds at {config.altitude_m:g} m")
