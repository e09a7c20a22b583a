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
import json
import logging
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from functools import partial
from pathlib import Path
from time import monotonic

from bridge.agents.bus_outlet import BusOutlet
from bridge.agents.client import UaClient
from bridge.agents.frames import frames_of
from bridge.agents.measurements import measurements_by_node
from bridge.agents.outlet import OnEvent
from bridge.agents.radio import queues_in, replies_in
from bridge.agents.running.feed import Arrivals, DeliveredPacket, Feeder
from bridge.bus.handling import PLAIN, Handling
from bridge.bus.identity.roster import node_identity
from bridge.bus.inbox import Inbox
from bridge.bus.keys import MAIN, Keys
from bridge.bus.messages import (
    AgentStatus,
    AircraftState,
    Clock,
    CommandEvent,
    CommandGoal,
    CommunicationStatus,
    DecodeError,
    Header,
    Measurements,
    RadioStatus,
    decode,
)
from bridge.bus.reception import radio_of, signal_of
from bridge.bus.replies import event_of
from bridge.bus.session import Sample, Session, SessionError, Stamp
from bridge.record.inputs.fields import VERBS
from bridge.record.logged import LoggedValue
from bridge.run.access import Access, access_of, directory_of
from bridge.timeouts import COMMAND_QUERY_S, FIRST_STATE_S, RADIO_ANSWER_S

log = logging.getLogger("beside")
ASK_AGAIN_S = 0.1
"""For a radio that has yet to start."""
UNANSWERED_TICKS = 3
"""Ticks without an answer, after which a node has nobody who answers: the first may be from before the program."""
_Came = Callable[[], object]
"""Something that Zenoh brought, and what is to be done with it."""


class FreeOutlet(BusOutlet):
    """What a node's ``free`` program says (`bridge.agents.outlet.AgentOutlet`); its commands are queries.

    Args:
        session: of the program.
        keys: of the run.
        node: its id.
        inbox: brings replies into the program's event loop.
        arrivals: where they wait for the tick.
    """

    def __init__(
        self, session: Session, keys: Keys, node: str, inbox: Inbox[_Came], arrivals: Arrivals
    ) -> None:
        super().__init__(session, keys, node)
        self._inbox, self._arrivals = inbox, arrivals

    def command(self, verb: str, goal: CommandGoal, on_event: OnEvent) -> None:
        """Ask the aircraft's queryable; of a command that there is not, nobody would answer."""
        if verb not in VERBS:
            text = f"command {verb!r} is none of {', '.join(VERBS)}"
            on_event(CommandEvent(CommandEvent.RESULT, False, text, outcome="refused"))
            return
        asked = _Asked(self._arrivals, on_event)
        self._session.query(
            self._keys.command(self._node, verb),
            goal,
            lambda reply: self._inbox.push(lambda: asked.came(event_of(reply))),
            lambda: self._inbox.push(asked.ended),
            timeout_s=COMMAND_QUERY_S,
        )


class ScriptOutlet(FreeOutlet):
    """What a script says beside a node's agent: commands, and the rest to its own log."""

    def transmit(
        self,
        to: str,  # noqa: ARG002
        channel: str,  # noqa: ARG002
        payload: bytes,  # noqa: ARG002
        encoding: str,  # noqa: ARG002
        stamp: Stamp,  # noqa: ARG002
        handling: Handling = PLAIN,  # noqa: ARG002
        radio: str = MAIN,  # noqa: ARG002
    ) -> None:
        """Refuse, as the node's agent numbers its packets.

        Raises:
            PermissionError: always.
        """
        raise PermissionError(
            f"only the agent of node {self._node} may transmit: it numbers the packets. To transmit from here, "
            "give the node an agent of type free, and connect_ua(..., is_sender=True)"
        )

    def report(self, status: AgentStatus) -> None:
        """Write it to the script's log."""
        log.info("%s", status.activity)

    def log(self, item: LoggedValue, sim_time_ns: int) -> None:  # noqa: ARG002
        """Write it to the script's log."""
        log.info("%s = %r", item.name, item.value)


class _Asked:
    """A command that was asked for: its events wait for a tick, but a missing answer is reported at once."""

    def __init__(self, arrivals: Arrivals, on_event: OnEvent) -> None:
        self._arrivals, self._on_event = arrivals, on_event
        self._has_result = False

    def came(self, event: CommandEvent) -> None:
        self._has_result |= event.phase == CommandEvent.RESULT
        self._arrivals.event_came(self._on_event, event)

    def ended(self) -> None:
        if not self._has_result:
            self._on_event(None)


class _TicksOnBus:
    """Gives what Zenoh brings to a program, tick by tick, as its host gives it to an agent on board.

    All that belongs to a tick is there when the node has answered it: its state, and before it what the radio settled
    at the tick before, up to its release. For a node that no host serves, nobody answers. Clock, answer and release
    are of three processes and may overtake each other: a tick waits for those it needs, and what the radio settled at
    this very tick waits for the next.
    """

    def __init__(
        self, session: Session, keys: Keys, ua: UaClient, inbox: Inbox[_Came], arrivals: Arrivals
    ) -> None:
        self.feeder = Feeder(ua)
        self.has_begun = asyncio.Event()
        """Set once the program has its node's state, or has nothing to wait for any more."""
        self._ua, self._arrivals = ua, arrivals
        self._before_ns = self._clock_ns = self._answered_ns = self._released_ns = -1
        self._is_due = self._has_state = self._has_left = False
        self._unanswered = 0
        self._settled: list[_Came] = []
        self._released: list[tuple[int, list[_Came]]] = []
        for key, handler in (
            (keys.rx(ua.node, "*", "*"), partial(self._settled_came, self._packet_came)),
            (keys.comm_status(ua.node), partial(self._settled_came, self._comm_status_came)),
            (keys.radio_status(ua.node), partial(self._settled_came, self._radio_status_came)),
            (keys.measurements(ua.node), partial(self._settled_came, self._measurements_came)),
            (keys.clock_release, self._release_came),
            (keys.state(ua.node), self._state_came),
            (keys.clock, self._clock_came),
            (keys.answer(ua.node), self._answer_came),
            (keys.clock_end, self._end_came),
        ):
            take = partial(self._take, handler)
            session.subscribe(key, lambda sample, take=take: inbox.push(partial(take, sample)))  # type: ignore[misc]
        session.watch_alive(  # a run that is killed says no word of its end
            keys.alive("router"), lambda _, is_alive: None if is_alive else inbox.push(self.end)
        )

    def leave(self) -> None:
        """The program leaves: what has come and waits for the event loop is given to it no more."""
        self._has_left = True

    def _take(self, handler: Callable[[Sample], None], sample: Sample) -> None:
        if self._has_left:
            return
        try:
            handler(sample)
        except DecodeError as error:
            self._ua.malformed += 1
            log.warning("%s: %s", sample.key_expr, error)

    def _settled_came(self, handler: Callable[[Sample], None], sample: Sample) -> None:
        self._settled.append(partial(self._take, handler, sample))

    def _release_came(self, sample: Sample) -> None:
        self._released_ns = decode(sample.payload.to_bytes(), Header).stamp.ns
        self._released.append((self._released_ns, self._settled))
        self._settled = []
        self._tick_if_due()

    def _clock_came(self, sample: Sample) -> None:
        self._before_ns, self._clock_ns = (
            self._clock_ns,
            decode(sample.payload.to_bytes(), Clock).header.stamp.ns,
        )
        self._is_due = True
        self._tick_if_due()

    def _answer_came(self, sample: Sample) -> None:
        self._answered_ns = decode(sample.payload.to_bytes(), Header).stamp.ns
        self._tick_if_due()

    def _end_came(self, _: Sample) -> None:
        self.end()

    def end(self) -> None:
        """The run is over; what became of commands at its last tick is told, as no tick will bring it."""
        for arrival in self._arrivals.take_events():
            arrival(self._ua)
        self._ua.end()
        self.has_begun.set()

    def _tick_if_due(self) -> None:
        is_answered = self._answered_ns < 0 or self._answered_ns >= self._clock_ns
        is_released = self._released_ns < 0 or self._released_ns >= self._before_ns
        if not (self._is_due and is_answered and is_released):
            return
        self._is_due = False
        for _, settled in (each for each in self._released if each[0] != self._clock_ns):
            for came in settled:
                came()
        self._released = [each for each in self._released if each[0] == self._clock_ns]
        self.feeder.tick(self._clock_ns, self._arrivals.take())
        self._unanswered += self._answered_ns < 0
        if self._has_state or self._unanswered >= UNANSWERED_TICKS:
            self.has_begun.set()

    def _state_came(self, sample: Sample) -> None:
        self._arrivals.state_came(decode(sample.payload.to_bytes(), AircraftState))
        self._has_state = True

    def _comm_status_came(self, sample: Sample) -> None:
        payload = sample.payload.to_bytes()
        self._arrivals.comm_status_came(lambda: self._ua.read(payload, CommunicationStatus))

    def _measurements_came(self, sample: Sample) -> None:
        message = decode(sample.payload.to_bytes(), Measurements)
        for measurements in measurements_by_node(message).values():
            self._arrivals.measurements_came(measurements)

    def _radio_status_came(self, sample: Sample) -> None:
        message = decode(sample.payload.to_bytes(), RadioStatus)
        for reply, radio in replies_in(message):
            self._arrivals.reply_came(reply, radio)
        for queue, radio in queues_in(message):
            self._arrivals.queue_changed(queue, radio)

    def _packet_came(self, sample: Sample) -> None:
        sender, channel = str(sample.key_expr).split("/")[-2:]
        stamp = Stamp.from_sample(sample)
        if stamp is None:
            raise DecodeError("a packet without its number and time")
        packet = DeliveredPacket(sender, channel, sample.payload.to_bytes(), stamp, radio_of(sample))
        self._arrivals.packet_came(packet, *signal_of(sample))


async def _next_packet(session: Session, keys: Keys, node: str) -> Stamp:
    """Number and least sim time of the next packet of ``node``, from the radio, for a program that may transmit as it.

    Raises:
        PermissionError: another one numbers its packets, or they are those of a record.
        SessionError: no radio answers.
    """
    replies: asyncio.Queue[CommandEvent | None] = asyncio.Queue()
    inbox: Inbox[CommandEvent | None] = Inbox(asyncio.get_running_loop(), replies.put_nowait)
    until = monotonic() + RADIO_ANSWER_S
    while monotonic() < until:
        session.query(
            keys.next_packet(node),
            Header.at(0, node),
            lambda reply: inbox.push(event_of(reply)),
            lambda: inbox.push(None),
            timeout_s=until - monotonic(),
        )
        while (event := await replies.get()) is not None:
            if event.success:
                return Stamp(**json.loads(event.value))
            if event.outcome == "refused":
                raise PermissionError(event.text)
        await asyncio.sleep(ASK_AGAIN_S)
    raise SessionError(
        f"the radio does not answer with the next packet of node {node}: is the run still running?"
    )


@asynccontextmanager
async def connect_ua(
    run: str | Path, node: str | int, *, is_sender: bool = False, access: Access | None = None
) -> AsyncIterator[UaClient]:
    """Join a run beside the agent of ``node``, or in place of one.

    It begins with the node's state, as an agent on board does: ``state`` is None only where the autopilot does not
    know yet where it is, for a ``free`` node on the ground, which no host serves, or if no state comes within
    `FIRST_STATE_S` of wall time, as from a clock that is held.

    Args:
        run: its directory, or its name if that is in `runs/`.
        node: id of the node, as text or as a number.
        is_sender: transmit as the node, whose agent in the scenario is of type ``free``. Numbers go on where the
            program before it ended: one at a time transmits as a node.
        access: what `lostlink token` printed, if the directory is not at hand; ``run`` is then not looked at.

    Raises:
        PermissionError: ``is_sender``, and the node has an agent that is not ``free``, or the run repeats a record.
        SessionError: if there is no such run, or it is over; the text says which.
    """
    node, frames, reach = str(node), None, {}
    if access is None:
        access = access_of(run, node_identity(node))
        scenario = directory_of(run).scenario
        frames, reach = frames_of(scenario, node), scenario.reach_of(node)
    with access.open() as session:
        keys, arrivals = Keys(access.run), Arrivals()
        inbox: Inbox[_Came] = Inbox(asyncio.get_running_loop(), lambda came: came())
        outlet = (FreeOutlet if is_sender else ScriptOutlet)(session, keys, node, inbox, arrivals)
        ua = UaClient(node, outlet, reach=reach, frames=frames)
        ticks = _TicksOnBus(session, keys, ua, inbox, arrivals)
        if is_sender:
            ua.go_on_from(await _next_packet(session, keys, node))
        with suppress(TimeoutError):  # the clock is held
            await asyncio.wait_for(ticks.has_begun.wait(), FIRST_STATE_S)
        try:
            yield ua
        except Exception as error:
            if is_sender and not ua.is_over:
                ticks.feeder.fail_in_flight(error)
            raise
        finally:
            ticks.leave()
            if is_sender:
                ua.report("its program leaves")
            if not ua.is_over:
                ua.end("the program has left the run")
