"""Where what a node says goes: Zenoh."""

from __future__ import annotations

from bridge.agents.sender import Sender
from bridge.bus.keys import Keys
from bridge.bus.messages import AircraftState, Header, RadioSwitch
from bridge.bus.session import Session
from bridge.record.logged import LoggedValue


class ZenohOutlets(Sender):
    """What one node says, on Zenoh (`bridge.host.node.Outlets`)."""

    def __init__(self, session: Session, keys: Keys, node: str) -> None:
        super().__init__(session, keys, node)
        self._wants_logged = session.interest(keys.logged(node, "*"))

    def logged(self, item: LoggedValue, sim_time_ns: int) -> None:
        """Publish what the agent logged, if anybody subscribes."""
        if self._wants_logged():
            self.log(item, sim_time_ns)

    def state(self, state: AircraftState) -> None:
        """Publish the aircraft's state."""
        self._session.put(self._keys.state(self._node), state)

    def switch_radio(self, sim_time_ns: int, *, on: bool) -> None:
        """Tell the radio that this node's was switched."""
        switch = RadioSwitch(Header.at(sim_time_ns, self._node), on)
        self._session.put(self._keys.radio(self._node), switch, must_arrive=True)

    def answer(self, sim_time_ns: int) -> None:
        """Tell the radio that this node is done with a tick."""
        self._session.put(self._keys.answer(self._node), Header.at(sim_time_ns, self._node), must_arrive=True)
