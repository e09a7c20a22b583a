"""One node as its agents see it: state, commands, radio, sim time. Nothing of another node or of the truth.

A script beside the node's agent may watch and command the aircraft; it cannot transmit, since one sender, the
agent, numbers a node's packets:

    async with connect_ua("tcp/127.0.0.1:7447", run="20261121T120000Z-separation", node="1") as ua:
        await ua.wait_for(lambda state: state.armed)
        await ua.rtl()
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

import zenoh

from bridge.bus.inbox import Inbox
from bridge.bus.keys import Keys, checked_chunk
from bridge.bus.messages import (
    AgentStatus,
    AircraftState,
    Clock,
    CommandEvent,
    CommandGoal,
    CommunicationStatus,
    DecodeError,
    Header,
    Message,
    decode,
    encode,
    encoding_of,
)
from bridge.bus.session import AGENT, Sample, Session, Stamp, open_client

COMMAND_TIMEOUT_S = 3600.0
"""Wall time; the aircraft's own time-outs come long before."""


class CommandFailed(RuntimeError):
    """The aircraft refused a command or could not carry it out; the text says why."""


_Waiter = tuple[Callable[[AircraftState], bool], "asyncio.Future[AircraftState]", float]


class UaClient:
    """A node's view of the run.

    Callbacks run in the asyncio loop, in the order in which things happened on the wire.

    Args:
        session: to the run's router.
        keys: of the run.
        node: id of the node.
        is_agent: this is the node's agent: it may transmit.
    """

    def __init__(self, session: Session, keys: Keys, node: str, *, is_agent: bool = False) -> None:
        self.node = node
        self.state: AircraftState | None = None
        self.comm_status: CommunicationStatus | None = None
        self.sim_time_ns = 0
        self.sent = 0
        self.received = 0
        self.malformed = 0
        self.on_error: Callable[[Exception], object] | None = None
        """Told of what a callback raises; without it, that is logged."""
        self._is_agent = is_agent
        self._session = session
        self._keys = keys
        self._loop = asyncio.get_running_loop()
        self._inbox: Inbox[tuple[Callable[[Sample], None], Sample]] = Inbox(self._loop, self._dispatch)
        self._waiters: set[_Waiter] = set()
        self._on_tick: list[Callable[[int], object]] = []
        self._on_packet: list[Callable[[str, str, bytes, Stamp], object]] = []
        for key, handler in (
            (keys.rx(node, "*", "*"), self._packet_came),
            (keys.comm_status(node), self._comm_status_came),
            (keys.state(node), self._state_came),
            (keys.clock, self._clock_came),
        ):
            session.subscribe(key, lambda sample, handler=handler: self._inbox.push((handler, sample)))  # type: ignore[misc]

    @property
    def dropped(self) -> int:
        """Samples that came faster than this process could take them."""
        return self._inbox.dropped

    # --- what comes in

    def on_tick(self, callback: Callable[[int], object]) -> None:
        """Call ``callback(sim_time_ns)`` at each tick of the fleet clock."""
        self._on_tick.append(callback)

    def on_packet(self, callback: Callable[[str, str, bytes, Stamp], object]) -> None:
        """Call ``callback(sender, channel, payload, stamp)`` for each packet that the radio delivers."""
        self._on_packet.append(callback)

    async def wait_for(
        self, condition: Callable[[AircraftState], bool], *, timeout_s: float = math.inf
    ) -> AircraftState:
        """Wait until the aircraft's state meets ``condition``; returns that state.

        Raises:
            TimeoutError: it did not within ``timeout_s`` of sim time.
            Exception: whatever ``condition`` raises.
        """
        if self.state is not None and condition(self.state):
            return self.state
        future: asyncio.Future[AircraftState] = self._loop.create_future()
        waiter = (condition, future, self.sim_time_ns + timeout_s * 1e9)
        self._waiters.add(waiter)
        try:
            return await future
        finally:
            self._waiters.discard(waiter)

    # --- what goes out

    def transmit(self, channel: str, payload: bytes | Message) -> int:
        """Give a packet to the radio, stamped with the present sim time. Returns its sequence number.

        Raises:
            ValueError: ``channel`` cannot be part of a key.
            PermissionError: this is not the node's agent.
        """
        if not self._is_agent:
            raise PermissionError(f"only the agent of UA {self.node} may transmit: it numbers the packets")
        key = self._keys.tx(self.node, checked_chunk(channel))
        seq, self.sent = self.sent, self.sent + 1
        stamp = Stamp(seq, self.sim_time_ns, AGENT)
        self._session.put_bytes(
            key,
            encode(payload) if isinstance(payload, Message) else payload,
            encoding=encoding_of(type(payload)) if isinstance(payload, Message) else None,
            attachment=stamp.to_bytes(),
            must_arrive=True,
        )
        return seq

    def report(self, activity: str, *, done: bool = False, failed: bool = False) -> None:
        """Say what the agent is doing."""
        header = Header.at(self.sim_time_ns, self.node)
        status = AgentStatus(header, activity, done, failed, self.sent, self.received)
        self._session.put(self._keys.agent(self.node), status, must_arrive=True)

    def answer_tick(self, sim_time_ns: int) -> None:
        """Tell the clock that this agent has done all it will do at this tick."""
        self._session.put(
            self._keys.clock_answer(self.node), Header.at(sim_time_ns, self.node), must_arrive=True
        )

    # --- commands

    async def command(
        self,
        verb: str,
        goal: CommandGoal | None = None,
        on_feedback: Callable[[CommandEvent], object] | None = None,
    ) -> CommandEvent:
        """Have the aircraft carry out ``verb``; returns the result once it is there.

        Raises:
            CommandFailed: if the aircraft refuses or fails, or nobody serves the command.
        """
        events: asyncio.Queue[CommandEvent | None] = asyncio.Queue()
        inbox: Inbox[CommandEvent | None] = Inbox(self._loop, events.put_nowait)

        def on_reply(reply: zenoh.Reply) -> None:
            inbox.push(_event_of(reply))

        self._session.query(
            self._keys.command(self.node, verb),
            goal or CommandGoal(),
            on_reply,
            lambda: inbox.push(None),
            timeout_s=COMMAND_TIMEOUT_S,
        )
        while (event := await events.get()) is not None:
            if event.phase == CommandEvent.RESULT:
                if not event.success:
                    raise CommandFailed(f"UA {self.node}: {verb}: {event.text}")
                return event
            if on_feedback is not None and event.phase == CommandEvent.FEEDBACK:
                on_feedback(event)
        raise CommandFailed(f"UA {self.node}: {verb}: nobody carried it out to the end")

    async def arm(self) -> None:
        """Arm the motors."""
        await self.command("arm")

    async def disarm(self) -> None:
        """Disarm the motors."""
        await self.command("disarm")

    async def set_mode(self, mode: str) -> None:
        """Change the flight mode, by the autopilot's own name."""
        await self.command("mode", CommandGoal(mode=mode))

    async def takeoff(self, altitude_rel_m: float) -> None:
        """Take off and climb to ``altitude_rel_m`` above home."""
        await self.command("takeoff", CommandGoal(altitude_rel_m=altitude_rel_m))

    async def goto(
        self,
        latitude_deg: float,
        longitude_deg: float,
        altitude_rel_m: float,
        *,
        speed_mps: float = 0.0,
        on_feedback: Callable[[CommandEvent], object] | None = None,
    ) -> None:
        """Fly to a point; returns when it is reached. ``speed_mps`` 0: as the autopilot is set."""
        goal = CommandGoal("", longitude_deg, latitude_deg, altitude_rel_m, speed_mps)
        await self.command("goto", goal, on_feedback)

    async def rtl(self) -> None:
        """Return to launch and land."""
        await self.command("rtl")

    async def land(self) -> None:
        """Land here."""
        await self.command("land")

    # --- inside

    def _dispatch(self, item: tuple[Callable[[Sample], None], Sample]) -> None:
        handler, sample = item
        try:
            handler(sample)
        except DecodeError:
            self.malformed += 1
        except Exception as error:  # callbacks are somebody's own code
            if self.on_error is None:
                raise
            self.on_error(error)

    def _clock_came(self, sample: Sample) -> None:
        self.sim_time_ns = decode(sample.payload.to_bytes(), Clock).header.stamp.ns
        for _, future, deadline_ns in tuple(self._waiters):
            if self.sim_time_ns > deadline_ns and not future.done():
                future.set_exception(
                    TimeoutError(f"still waiting at {self.sim_time_ns / 1e9:.1f} s of sim time")
                )
        for callback in self._on_tick:
            callback(self.sim_time_ns)

    def _state_came(self, sample: Sample) -> None:
        self.state = decode(sample.payload.to_bytes(), AircraftState)
        for condition, future, _ in tuple(self._waiters):
            if future.done():
                continue
            try:
                if condition(self.state):
                    future.set_result(self.state)
            except Exception as error:  # somebody's own code: it is for whoever waits
                future.set_exception(error)

    def _comm_status_came(self, sample: Sample) -> None:
        self.comm_status = decode(sample.payload.to_bytes(), CommunicationStatus)

    def _packet_came(self, sample: Sample) -> None:
        sender, channel = str(sample.key_expr).split("/")[-2:]
        self.received += 1
        stamp = Stamp.from_sample(sample) or Stamp(-1, self.sim_time_ns)
        for callback in self._on_packet:
            callback(sender, channel, sample.payload.to_bytes(), stamp)


def _event_of(reply: zenoh.Reply) -> CommandEvent:
    if reply.ok is None:
        text = reply.err.payload.to_string() if reply.err is not None else "no reply"
        return CommandEvent(CommandEvent.RESULT, False, text, math.nan)
    try:
        return decode(reply.ok.payload.to_bytes(), CommandEvent)
    except DecodeError as error:
        return CommandEvent(CommandEvent.RESULT, False, str(error), math.nan)


@asynccontextmanager
async def connect_ua(endpoint: str, run: str, node: str) -> AsyncIterator[UaClient]:
    """Join a run beside the agent of ``node``.

    Raises:
        SessionError: if there is no router at ``endpoint``.
    """
    with open_client(endpoint) as session:
        yield UaClient(session, Keys(run), node)
