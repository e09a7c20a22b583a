"""Where what a node says goes: Zenoh."""

from __future__ import annotations

from bridge.bus.keys import Keys
from bridge.bus.messages import AgentStatus, AircraftState, Header
from bridge.bus.session import Session, Stamp


class ZenohOutlets:
    """What one node says, on Zenoh (`bridge.host.node.Outlets`)."""

    def __init__(self, session: Session, keys: Keys, node: str) -> None:
        self._session, self._keys, self._node = session, keys, node

    def transmit(self, to: str, channel: str, payload: bytes, encoding: str | None, stamp: Stamp) -> None:
        """Give a packet to the radio."""
        self._session.put_bytes(
            self._keys.tx(self._node, channel, to=to),
            payload,
            encoding=encoding,
            attachment=stamp.to_bytes(),
            must_arrive=True,
        )

    def report(self, status: AgentStatus) -> None:
        """Tell what the agent is doing."""
        self._session.put(self._keys.agent(self._node), status, must_arrive=True)

    def state(self, state: AircraftState) -> None:
        """Publish the aircraft's state."""
        self._session.put(self._keys.state(self._node), state)

    def answer(self, sim_time_ns: int) -> None:
        """Tell the radio that this node is done with a tick."""
        self._session.put(self._keys.answer(self._node), Header.at(sim_time_ns, self._node), must_arrive=True)
