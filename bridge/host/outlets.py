"""Where what a node says goes: Zenoh."""

from __future__ import annotations

from bridge.agents.sender import Sender
from bridge.bus.messages import AircraftState, Header


class ZenohOutlets(Sender):
    """What one node says, on Zenoh (`bridge.host.node.Outlets`)."""

    def state(self, state: AircraftState) -> None:
        """Publish the aircraft's state."""
        self._session.put(self._keys.state(self._node), state)

    def answer(self, sim_time_ns: int) -> None:
        """Tell the radio that this node is done with a tick."""
        self._session.put(self._keys.answer(self._node), Header.at(sim_time_ns, self._node), must_arrive=True)
