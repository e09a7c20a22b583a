"""One autopilot without sockets: physics calls it with sensor frames, its client reads and writes bytes.

Its turn is that of `standin.sockets`: when a frame is there, take what the client has said until then, step, speak to
the client, answer the physics. So the same bytes pass.
"""

from __future__ import annotations

from standin.autopilot import Autopilot
from standin.process import StandinError


class CalledStandIn:
    """An autopilot for a caller that has physics and client in its own process.

    Args:
        autopilot: the core.
        name: what messages call it.
    """

    def __init__(self, autopilot: Autopilot, name: str) -> None:
        self.name = name
        self._autopilot = autopilot
        self._wants_client = self._has_client = False
        self._heard: list[bytes] = []
        self._said: list[bytes] = []

    # Physics.

    @property
    def packet(self) -> bytes:
        """The latest servo packet."""
        return self._autopilot.fdm.packet

    def frame(self, datagram: bytes) -> bytes | None:
        """Take a sensor frame; return the servo packet that answers it, or None if it was none, or no new one.

        Raises:
            StandinError: its code failed.
        """
        try:
            return self._turn(datagram)
        except Exception as error:
            raise StandinError(self.name, error) from error

    def _turn(self, datagram: bytes) -> bytes | None:
        autopilot = self._autopilot
        if not autopilot.take_frame(datagram):
            return None
        if self._wants_client != self._has_client or self._heard:
            self._hear_client()
        packet = autopilot.step()
        if autopilot.mavlink.has_data:
            self._said.append(autopilot.mavlink.data_to_send())
        return packet

    def _hear_client(self) -> None:
        mavlink = self._autopilot.mavlink
        if self._wants_client != self._has_client:
            self._has_client = self._wants_client
            (mavlink.connect if self._has_client else mavlink.disconnect)()
        heard, self._heard = self._heard, []
        if heard and self._has_client:
            mavlink.receive(b"".join(heard))

    # The client, which takes effect at the next frame.

    def connect(self) -> None:
        """A client is there."""
        self._wants_client = True

    def disconnect(self) -> None:
        """It is gone."""
        self._wants_client = False
        self._heard.clear()
        self._said.clear()

    def read(self) -> bytes:
        """All that was said to the client since the last call."""
        said, self._said = self._said, []
        return b"".join(said)

    def write(self, data: bytes) -> None:
        """Say something to the autopilot."""
        self._heard.append(data)
