"""One autopilot without sockets: physics calls it with the numbers of sensor frames, its clients read and write bytes.

Its turn is that of `standin.sockets`: when a frame is there, take what the clients have said until then, step, speak to
them, answer the physics. So the same numbers and bytes pass.
"""

from __future__ import annotations

from collections.abc import Sequence

from standin.autopilot import Autopilot
from standin.ports import CalledPort
from standin.process import StandinError
from standin.wire.sensors import sensed_frame


class CalledStandIn(CalledPort):
    """An autopilot for a caller that has physics and clients in its own process; it is its own first port.

    Args:
        autopilot: the core.
        name: what messages call it.

    Attributes:
        serials: its further ports, by number.
    """

    def __init__(self, autopilot: Autopilot, name: str) -> None:
        super().__init__(autopilot.mavlink)
        self.name = name
        self._autopilot = autopilot
        self.serials = {number: CalledPort(mavlink) for number, mavlink in autopilot.serials.items()}
        self._ports = (self, *self.serials.values())

    @property
    def fields(self) -> tuple[int, ...]:
        """Those of the latest servo packet."""
        return self._autopilot.fdm.fields

    def frame(self, numbers: Sequence[float]) -> tuple[int, ...] | None:
        """Take a sensor frame; return the servo packet's fields that answer it, or None if it was none, or no new one.

        Args:
            numbers: as `sensed_frame` takes them.

        Raises:
            StandinError: its code failed.
        """
        try:
            return self._turn(numbers)
        except Exception as error:
            raise StandinError(self.name, error) from error

    def _turn(self, numbers: Sequence[float]) -> tuple[int, ...] | None:
        autopilot = self._autopilot
        if not autopilot.take_frame(sensed_frame(numbers)):
            return None
        for port in self._ports:
            port.hear()
        autopilot.step()
        for port in self._ports:
            port.say()
        return autopilot.fdm.fields
