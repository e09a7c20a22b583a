"""A UA as the API sees it: its daemon, by wall time; in a run commands go to the node (`bridge.host.api`)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from aps.base import DaemonBase
from aps.vehicle.execution import CommandProgress, CommandResult
from aps.vehicle.messages import LastMessage
from aps.vehicle.state import VehicleState
from aps.vehicle.status_text import StatusText


class DaemonBackend:
    """The API's view of a daemon.

    Args:
        daemon: the daemon.
    """

    def __init__(self, daemon: DaemonBase) -> None:
        self._daemon = daemon

    def state(self) -> VehicleState:
        """The state now."""
        return self._daemon.state

    def statistics(self) -> dict[str, Any]:
        """Counters of everything."""
        return self._daemon.statistics()

    def status(self) -> dict[str, Any]:
        """State and counters: what ``lostlink aps status`` shows."""
        return self._daemon.told()

    def places(self) -> list[tuple[int | None, str]]:
        """Where links are opened: a number if that can be ended, and the address."""
        numbers = {driver: number for number, driver in self._daemon.opened.items()}
        return [(numbers.get(driver), str(driver.address)) for driver in self._daemon.drivers]

    async def open_links(self, address: str) -> int:
        """Open links at a place; returns its number.

        Raises:
            ValueError: the address cannot be read.
            OSError: a port is taken.
        """
        driver = await self._daemon.open(address)
        return next(number for number, other in self._daemon.opened.items() if other is driver)

    async def shut_links(self, number: int) -> bool:
        """End what was opened, with its links; returns whether there was such a place."""
        driver = self._daemon.opened.get(number)
        if driver is not None:
            await self._daemon.shut(driver)
        return driver is not None

    def message_names(self) -> list[str]:
        """The MAVLink messages that the autopilot has sent."""
        return self._daemon.vehicle.messages.names()

    def last_message(self, name: str) -> LastMessage | None:
        """The last message of a type, ``None`` if none came.

        Raises:
            ValueError: there is no message of this name.
        """
        return self._daemon.vehicle.messages.last(name, self._daemon.state.as_of_ns)

    def start(
        self,
        verb: str,
        arguments: Mapping[str, Any],
        on_progress: Callable[[CommandProgress], None],
        on_done: Callable[[CommandResult], None],
    ) -> None:
        """Start a command; ``on_done`` is called once, perhaps within this call.

        Raises:
            ValueError: no such verb, or a wrong argument.
        """
        self._daemon.commands.start_named(verb, arguments, on_progress=on_progress, on_done=on_done)

    def listen(
        self, on_state: Callable[[VehicleState], None], on_text: Callable[[StatusText], None]
    ) -> Callable[[], None]:
        """Subscribe to every new state and to the autopilot's texts; returns what ends it."""
        subscription = self._daemon.subscribe(on_state)
        texts = self._daemon.vehicle.text_listeners
        texts.append(on_text)

        def end() -> None:
            subscription.cancel()
            texts.remove(on_text)

        return end
