"""Stays on the ground and transmits."""

from __future__ import annotations

from bridge.agents.agent import Agent


class Still(Agent):
    """Never arms: for links without flight, and for tests."""

    async def fly(self) -> None:
        """Nothing to fly."""
        self.ua.report("stays on the ground")
