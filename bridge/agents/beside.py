"""A script beside a run: watches a node and commands its aircraft, over Zenoh and in wall time.

It cannot transmit as a node that has an agent, since one sender numbers a node's packets; as a node whose agent is
``free`` it can:

    async with connect_ua("runs/20261121T120000Z-separation", node="1") as ua:
        await ua.wait_for(lambda state: state.armed)
        await ua.rtl()

What it commands takes effect at the next tick, and is recorded as an input of the run. The clock does not wait for it:
a run with a ``free`` node that transmits may not repeat.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path

from bridge.agents.client import OnEvent, UaClient
from bridge.agents.measurements import measurements_by_node
from bridge.agents.sender import Sender
from bridge.bus.identity.roster import node_identity
from bridge.bus.inbox import Inbox
from bridge.bus.keys import Keys
from bridge.bus.messages import (
    AgentStatus,
    AircraftState,
    Clock,
    CommandEvent,
    CommandGoal,
    CommunicationStatus,
    DecodeError,
    Measurements,
    decode,
)
from bridge.bus.reception import Reception
from bridge.bus.replies import event_of
from bridge.bus.session import Sample, Session, Stamp
from bridge.record.logged import LoggedValue
from bridge.run.access import Access, access_of
from bridge.timeouts import COMMAND_QUERY_S

log = logging.getLogger("beside")


class ZenohOutlet:
    """Commands go to the aircraft as queries; packets to the radio, if the node has no other sender."""

    def __init__(self, session: Session, keys: Keys, node: str, *, is_sender: bool) -> None:
        self._session, self._keys, self._node = session, keys, node
        self._sender = Sender(session, keys, node) if is_sender else None
        self._loop = asyncio.get_running_loop()

    def transmit(self, to: str, channel: str, payload: bytes, encoding: str | None, stamp: Stamp) -> None:
        """Give a packet to the radio.

        Raises:
            PermissionError: another one numbers the node's packets.
        """
        if self._sender is None:
            raise PermissionError(
                f"only the agent of node {self._node} may transmit: it numbers the packets. To transmit from here, "
                "give the node an agent of type free, and connect_ua(..., is_sender=True)"
            )
        self._sender.transmit(to, channel, payload, encoding, stamp)

    def report(self, status: AgentStatus) -> None:
        """A sender's word is published, as an agent's; another script's goes to its log."""
        log.info("%s", status.activity)
        if self._sender is not None:
            self._sender.report(status)

    def log(self, item: LoggedValue, sim_time_ns: int) -> None:
        """A sender's values are published, though not recorded; another script's go to its log."""
        if self._sender is None:
            log.info("%s = %r", item.name, item.value)
        else:
            self._sender.log(item, sim_time_ns)

    def command(self, verb: str, goal: CommandGoal, on_event: OnEvent) -> None:
        """Ask the aircraft's queryable."""
        inbox: Inbox[CommandEvent | None] = Inbox(self._loop, on_event)
        self._session.query(
            self._keys.command(self._node, verb),
            goal,
            lambda reply: inbox.push(event_of(reply)),
            lambda: inbox.push(None),
            timeout_s=COMMAND_QUERY_S,
        )


class _Feed:
    """Gives what Zenoh brings to a client, in the order in which it happened on the wire."""

    def __init__(self, session: Session, keys: Keys, ua: UaClient) -> None:
        self._ua = ua
        self.malformed = 0
        self._inbox: Inbox[tuple[Callable[[Sample], None], Sample]] = Inbox(
            asyncio.get_running_loop(), self._dispatch
        )
        for key, handler in (
            (keys.rx(ua.node, "*", "*"), self._packet_came),
            (keys.comm_status(ua.node), self._comm_status_came),
            (keys.measurements(ua.node), self._measurements_came),
            (keys.state(ua.node), self._state_came),
            (keys.clock, self._clock_came),
        ):
            session.subscribe(key, lambda sample, handler=handler: self._inbox.push((handler, sample)))  # type: ignore[misc]

    def _dispatch(self, item: tuple[Callable[[Sample], None], Sample]) -> None:
        handler, sample = item
        try:
            handler(sample)
        except DecodeError as error:
            self.malformed += 1
            log.warning("%s: %s", sample.key_expr, error)

    def _clock_came(self, sample: Sample) -> None:
        self._ua.take_clock(decode(sample.payload.to_bytes(), Clock).header.stamp.ns)
        self._ua.tick()

    def _state_came(self, sample: Sample) -> None:
        self._ua.take_state(decode(sample.payload.to_bytes(), AircraftState))

    def _comm_status_came(self, sample: Sample) -> None:
        payload = sample.payload.to_bytes()
        self._ua.take_comm_status(lambda: self._ua.read(payload, CommunicationStatus))

    def _measurements_came(self, sample: Sample) -> None:
        message = decode(sample.payload.to_bytes(), Measurements)
        for measurements in measurements_by_node(message).values():
            self._ua.take_measurements(measurements)

    def _packet_came(self, sample: Sample) -> None:
        sender, channel = str(sample.key_expr).split("/")[-2:]
        reception = Reception.from_sample(sample, self._ua.sim_time_ns)
        self._ua.take_packet(sender, channel, sample.payload.to_bytes(), reception)


@asynccontextmanager
async def connect_ua(
    run: str | Path, node: str, *, is_sender: bool = False, access: Access | None = None
) -> AsyncIterator[UaClient]:
    """Join a run beside the agent of ``node``, or in place of one.

    Args:
        run: its directory, or its name if that is in `runs/`.
        node: id of the node.
        is_sender: transmit as the node, whose agent in the scenario is of type ``free``. Numbers begin at 0: one
            program transmits as a node in a run.
        access: what `lostlink token` printed, if the directory is not at hand; ``run`` is then not looked at.

    Raises:
        SessionError: if there is no such run, or it is over; the text says which.
    """
    access = access or access_of(run, node_identity(node))
    with access.open() as session:
        keys = Keys(access.run)
        ua = UaClient(node, ZenohOutlet(session, keys, node, is_sender=is_sender))
        _Feed(session, keys, ua)
        try:
            yield ua
        finally:
            if is_sender:
                ua.report("leaves")
