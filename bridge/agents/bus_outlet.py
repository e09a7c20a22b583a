"""What is said as a node, on Zenoh."""

from __future__ import annotations

from bridge.bus.handling import PLAIN, Handling, handling_bytes
from bridge.bus.keys import MAIN, Keys
from bridge.bus.messages import AgentStatus, AircraftState, Header, RadioSwitch
from bridge.bus.session import JSON, Session, Stamp
from bridge.record.logged import LoggedValue, as_json


class BusOutlet:
    """Speaks for one node (`bridge.agents.outlet.NodeOutlet`).

    Args:
        session: of a process that may speak for the node.
        keys: of the run.
        node: its id.
    """

    def __init__(self, session: Session, keys: Keys, node: str) -> None:
        self._session, self._keys, self._node = session, keys, node
        self._wants_logged = session.interest(keys.logged(node, "*"))

    def transmit(
        self,
        to: str,
        channel: str,
        payload: bytes,
        encoding: str,
        stamp: Stamp,
        handling: Handling = PLAIN,
        radio: str = MAIN,
    ) -> None:
        """Give a packet to the radio."""
        self._session.put_bytes(
            self._keys.tx(self._node, channel, to=to, radio=radio),
            payload,
            encoding=encoding,
            attachment=stamp.to_bytes() + handling_bytes(handling),
            must_arrive=True,
        )

    def report(self, status: AgentStatus) -> None:
        """Report what the agent is doing."""
        self._session.put(self._keys.agent(self._node), status, must_arrive=True)

    def warn(self, text: str, sim_time_ns: int) -> None:
        """Tell whoever watches the run what they must see; it waits for nobody, and the record has it anyway."""
        self._session.put(self._keys.warning(self._node), Header.at(sim_time_ns, text))

    def log(self, item: LoggedValue, sim_time_ns: int) -> None:
        """Publish a value as JSON, if anybody subscribes; the attachment has the sim time."""
        if self._wants_logged():
            self._session.put_bytes(
                self._keys.logged(self._node, item.name),
                as_json(item.value).encode(),
                encoding=JSON,
                attachment=Stamp(-1, sim_time_ns).to_bytes(),
            )

    def state(self, state: AircraftState) -> None:
        """Publish the aircraft's state."""
        self._session.put(self._keys.state(self._node), state)

    def switch_radio(self, sim_time_ns: int, *, on: bool) -> None:
        """Report to the radio that this node's was switched."""
        switch = RadioSwitch(Header.at(sim_time_ns, self._node), on)
        self._session.put(self._keys.radio(self._node), switch, must_arrive=True)

    def serial(self, radio: str, data: bytes, sim_time_ns: int) -> None:
        """Give bytes of a host to the node's modem; the attachment has the sim time."""
        attachment = Stamp(-1, sim_time_ns).to_bytes()
        self._session.put_bytes(
            self._keys.serial(self._node, radio), data, encoding="", attachment=attachment, must_arrive=True
        )

    def answer(self, sim_time_ns: int) -> None:
        """Report to the radio that this node is done with a tick."""
        self._session.put(self._keys.answer(self._node), Header.at(sim_time_ns, self._node), must_arrive=True)
