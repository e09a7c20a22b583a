"""An agent that lets go when somebody else flies."""

from __future__ import annotations

from bridge.agents.agent import Agent
from bridge.agents.commands import CommandInterrupted


class Yielding(Agent):
    """Flies `mission`; when an operator, a ground station or a fail-safe takes the aircraft over, it is theirs.

    The agent transmits on, and is done when the aircraft has landed.
    """

    async def fly(self) -> None:
        """Fly, and leave the rest to whoever takes over. A UA that is disarmed or reboots in flight is a failure."""
        try:
            await self.mission()
        except CommandInterrupted as error:
            if self.ua.state is None or not self.ua.state.armed:
                raise
            await self.let_go(str(error))

    async def let_go(self, why: str) -> None:
        """Leave the aircraft to whoever took it over, until it has landed."""
        self.ua.report(f"yields: {why}")
        await self.ua.wait_for(lambda state: not state.armed)

    async def mission(self) -> None:
        """What it does while it is left alone."""
        raise NotImplementedError
