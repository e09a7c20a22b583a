"""What a node's sender says on Zenoh: packets, and what it is doing."""

from __future__ import annotations

from bridge.bus.keys import Keys
from bridge.bus.messages import AgentStatus
from bridge.bus.session import Session, Stamp
from bridge.record.logged import LoggedValue, as_json

JSON = "application/json"


class Sender:
    """Speaks for one node; whoever has it numbers the node's packets.

    Args:
        session: of a process that may speak for the node.
        keys: of the run.
        node: its id.
    """

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

    def log(self, item: LoggedValue, sim_time_ns: int) -> None:
        """Publish a value that the node logs, as JSON; the attachment has the sim time."""
        self._session.put_bytes(
            self._keys.logged(self._node, item.name),
            as_json(item.value).encode(),
            encoding=JSON,
            attachment=Stamp(-1, sim_time_ns).to_bytes(),
        )

    def report(self, status: AgentStatus) -> None:
        """Tell what the agent is doing."""
        self._session.put(self._keys.agent(self._node), status, must_arrive=True)
