"""A MAVLink port of an autopilot that is called: its client reads and writes bytes, which take effect at frames."""

from __future__ import annotations

from standin.protocols.endpoint import MavlinkEndpoint


class CalledPort:
    """One port, for a client in the same process.

    Args:
        mavlink: what speaks there.
    """

    def __init__(self, mavlink: MavlinkEndpoint) -> None:
        self._mavlink = mavlink
        self._wants_client = self._has_client = False
        self._heard: list[bytes] = []
        self._said: list[bytes] = []

    # The autopilot's side, at its frames.

    def hear(self) -> None:
        """Take what the client has said, and whether there is one."""
        if self._wants_client == self._has_client and not self._heard:
            return
        if self._wants_client != self._has_client:
            self._has_client = self._wants_client
            (self._mavlink.connect if self._has_client else self._mavlink.disconnect)()
        heard, self._heard = self._heard, []
        if heard and self._has_client:
            self._mavlink.receive(b"".join(heard))

    def say(self) -> None:
        """Give the client what there is for it."""
        if self._mavlink.has_data:
            self._said.append(self._mavlink.data_to_send())

    # The client's, which takes effect at the next frame.

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
