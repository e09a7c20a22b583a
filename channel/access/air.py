"""Transmissions on their way to all receivers (`channel.access.reception.receiver`).

A frame that meets no other passes the receivers whose access does not attend to it as a whole, when it is over
(`channel.access.reception.passing`). At all others its edges are events.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from channel.access.agenda import SIGNAL_ENDS, SIGNAL_STARTS, Agenda
from channel.access.packets import AirFrame, Loss
from channel.access.reception.passing import Notes, PassingFrame
from channel.access.reception.receiver import DeafEar, Ear, Hearing, Receiver
from channel.access.reception.sources import NOBODY, SensedSources
from channel.access.world import Arrival, Disturbed, FrameArrivals, Rows, World, name_of

__all__ = ["Air", "DeafEar", "Ear", "Hearing", "OnFates", "Receiver"]

Step = tuple[int, Callable[..., None], tuple[object, ...]]
"""An edge at a receiver: instant, ns, and what is called with what."""
OnFates = Callable[[AirFrame, Rows, NDArray[np.int64], NDArray[np.bool_]], object]
"""Takes a frame, nodes, when it has passed each, and whether it came through."""


class Air:
    """What is on the air of one network.

    Args:
        agenda: of the medium.
        world: what lies between the nodes.
        hearing: how receivers hear.
        on_fate: called with each frame at each node that it reaches, when it has passed: why it was lost, or None.
        on_fates: called with a frame that has passed several nodes, for which it came or was lost to noise; without it
            no frame passes as a whole.
        senses_sources: whether carrier sense decides who transmits, so that receivers have to know of interferers.
    """

    def __init__(
        self,
        agenda: Agenda,
        world: World,
        hearing: Hearing,
        on_fate: Callable[[AirFrame, int, Loss | None], object],
        on_fates: OnFates | None = None,
        *,
        senses_sources: bool = False,
    ) -> None:
        self.agenda, self.world, self.hearing, self.on_fate = agenda, world, hearing, on_fate
        self._on_fates = on_fates
        self._receivers: dict[int, Receiver] = {}
        self._attending: set[int] = set()
        self._notes = Notes(max(world.nodes, default=-1) + 1)
        self._passage: PassingFrame | None = None
        self._clear_ns = -1
        """Until this instant something may be on the air."""
        self._is_split = bool(hearing.channels)
        """Receivers may be on several channels."""
        sources = world.sources if senses_sources and isinstance(world, Disturbed) else None
        self._sources = None if sources is None else SensedSources(agenda, sources, self.ignore)

    def receiver(self, node: int) -> Receiver:
        """A node's receiver."""
        return self._receivers[node]

    def join(self, ears: Mapping[int, Ear]) -> dict[int, Receiver]:
        """Give each node its receiver; all attend but the deaf."""
        self._receivers = {node: Receiver(self, node, ear) for node, ear in sorted(ears.items())}
        self._attending = {node for node, ear in ears.items() if not isinstance(ear, DeafEar)}
        if self._sources is not None:
            self.agenda.at(0, SIGNAL_ENDS, NOBODY, self._senses, self._sources)
        return self._receivers

    def attend(self, receiver: Receiver) -> None:
        """A receiver's access acts on what it hears: what has passed it is made up for."""
        node = receiver.node
        if node in self._attending:
            return
        self._attending.add(node)
        if self._passage is not None:
            self._go_on_singly(self._passage, self._passage.take_out(node))
        self._make_up(node)
        if self._sources is not None:
            self._sources.follow(receiver)

    def _senses(self, sources: SensedSources) -> None:
        """Those that attend from the start sense what is on the air then."""
        for node in sorted(self._attending):
            sources.follow(self._receivers[node])

    def ignore(self, receiver: Receiver) -> None:
        """A receiver's access does nothing but note when it last heard something, and whether that had errors."""
        self._attending.discard(receiver.node)
        if self._sources is not None:
            self._sources.leave(receiver)

    def passes_singly(self) -> None:
        """No frame passes as a whole from now on: somebody acts on each fate at its instant."""
        self._on_fates = None

    def tunes(self) -> None:
        """A receiver is about to turn to another channel: frames reach no longer all alike."""
        self._is_split = True
        if self._passage is not None:
            self._end_passage(self._passage)

    def transmit(self, frame: AirFrame, then: Callable[[], object]) -> None:
        """Put a frame on the air now; ``then`` is called at its end, before anybody acts on it.

        Raises:
            ValueError: its transmitter is on the air still, as it is until ``then`` has returned.
        """
        node, agenda = frame.node, self.agenda
        if self._receivers[node].transmits:
            raise ValueError(
                f"node {name_of(self.world, node)} is to transmit at {agenda.now_ns} ns, and its radio is on the air "
                "still: it is free after the callback at the end of its frame"
            )
        if self._passage is not None:
            self._end_passage(self._passage)
        arrivals = self.world.reach(frame)
        if len(arrivals) < len(self._receivers) - 1:
            self._pass_by(frame, arrivals)
        last_ns = frame.ended_ns + (arrivals[-1].delay_ns if arrivals else 0)
        if isinstance(arrivals, FrameArrivals) and self._is_alone(frame, last_ns):
            singly = self._let_pass(frame, arrivals, last_ns)
        else:
            singly = arrivals
            for noted in self._notes.taken():
                self._make_up(noted)
        self._clear_ns = max(self._clear_ns, last_ns)
        self._receivers[node].begins_to_transmit()
        self._edges(frame, singly)
        agenda.at(frame.ended_ns, SIGNAL_ENDS, node, self._end, node, then)

    def _edges(self, frame: AirFrame, arrivals: Sequence[Arrival]) -> None:
        """Have a frame that starts now start and end at some receivers."""
        if not arrivals:
            return
        node, now_ns, receivers = frame.node, self.agenda.now_ns, self._receivers
        length_ns = frame.ended_ns - frame.started_ns
        there = [(now_ns + delay_ns, receivers[other], power_mw) for other, power_mw, delay_ns in arrivals]
        _Front(self.agenda, SIGNAL_STARTS, node, [(at, r.starts, (frame, p)) for at, r, p in there]).go()
        _Front(
            self.agenda, SIGNAL_ENDS, node, [(at + length_ns, r.ends, (frame,)) for at, r, _ in there]
        ).go()

    def _pass_by(self, frame: AirFrame, arrivals: Sequence[Arrival]) -> None:
        """Nothing comes of a frame to those that it does not reach."""
        reached = {frame.node, *(arrival.receiver for arrival in arrivals)}
        others = tuple(other for other in self._receivers if other not in reached)
        self.agenda.at(frame.ended_ns, SIGNAL_ENDS, frame.node, self._passed_by, frame, others)

    def _passed_by(self, frame: AirFrame, others: tuple[int, ...]) -> None:
        if self._on_fates is not None and frame.is_broadcast:
            nodes = np.array(others, dtype=np.intp)
            ended_ns = np.full(nodes.size, frame.ended_ns)
            self._on_fates(frame, nodes, ended_ns, np.zeros(nodes.size, dtype=bool))
            return
        for other in others:
            self.on_fate(frame, other, Loss.NOISE)

    def _end(self, node: int, then: Callable[[], object]) -> None:
        then()
        self._receivers[node].ends_to_transmit()

    # Frames that pass as a whole.

    def _is_alone(self, frame: AirFrame, last_ns: int) -> bool:
        """Whether a frame that starts now may pass as a whole: it is the only one, and over before the agenda stops."""
        return (
            self._on_fates is not None
            and frame.is_broadcast
            and self._clear_ns < frame.started_ns
            and last_ns <= self.agenda.until_ns
            and not self._is_split
            and frame.ended_ns - frame.started_ns > self.hearing.cca_ns
            and 2 * len(self._attending) <= len(self._receivers)
        )

    def _let_pass(self, frame: AirFrame, arrivals: FrameArrivals, last_ns: int) -> Sequence[Arrival]:
        """Let a frame pass those who do not attend; the others."""
        attending = self._attending
        for node in [node for node in attending if self._receivers[node].is_done()]:
            self.ignore(self._receivers[node])
        attend = [node in attending for node in arrivals.receiver.tolist()]
        rows = np.flatnonzero(~np.array(attend, dtype=bool))
        self._passage = PassingFrame(frame, arrivals, rows)
        self.agenda.at(last_ns, SIGNAL_ENDS, frame.node, self._has_passed, self._passage)
        return [arrivals[row] for row, attends in enumerate(attend) if attends]

    def _has_passed(self, passage: PassingFrame) -> None:
        if self._passage is passage:
            self._passage = None
            self._passed(passage, passage.take())

    def _passed(self, passage: PassingFrame, rows: Rows) -> None:
        """A frame has passed some of its receivers."""
        frame, arrivals, hearing = passage.frame, passage.arrivals, self.hearing
        followed = arrivals.power_mw[rows] >= hearing.preamble_mw
        came = np.zeros(len(rows), dtype=bool)
        came[followed] = arrivals.alone(frame, rows[followed])
        self._notes.take(passage, rows, followed, came, hearing)
        assert self._on_fates is not None
        self._on_fates(frame, arrivals.receiver[rows], passage.ends_ns[rows], came)
        self.agenda.handled += 2 * len(rows)

    def _end_passage(self, passage: PassingFrame) -> None:
        """Another frame starts: from now on each receiver is on its own."""
        self._passage = None
        self._go_on_singly(passage, passage.take())

    def _go_on_singly(self, passage: PassingFrame, rows: Rows) -> None:
        """Bring receivers, which a frame was passing, to where they would be by now, and have events for the rest."""
        frame, arrivals, now_ns = passage.frame, passage.arrivals, self.agenda.now_ns
        is_over = passage.ends_ns[rows] <= now_ns
        if is_over.any():
            self._passed(passage, rows[is_over])
            rows = rows[~is_over]
        starts: list[Step] = []
        ends: list[Step] = []
        times = zip(
            rows.tolist(), passage.starts_ns[rows].tolist(), passage.ends_ns[rows].tolist(), strict=True
        )
        for row, start_ns, end_ns in times:
            node, power_mw, _ = arrivals[row]
            receiver = self._receivers[node]
            if start_ns < now_ns:
                receiver.has_met(frame, power_mw, start_ns)
            else:
                starts.append((start_ns, receiver.starts, (frame, power_mw)))
            ends.append((end_ns, receiver.ends, (frame,)))
        for rank, steps in ((SIGNAL_STARTS, starts), (SIGNAL_ENDS, ends)):
            if steps:
                _Front(self.agenda, rank, frame.node, steps).go()

    def _make_up(self, node: int) -> None:
        """Tell a receiver what has passed it."""
        note = self._notes.take_out(node)
        if note is not None:
            self._receivers[node].has_heard(*note)


class _Front:
    """A signal's edge on its way over the receivers: one event of the agenda for those that nothing comes between."""

    __slots__ = ("_agenda", "_node", "_place", "_rank", "_steps")

    def __init__(self, agenda: Agenda, rank: int, node: int, steps: Sequence[Step]) -> None:
        self._agenda, self._rank, self._node, self._steps, self._place = agenda, rank, node, steps, 0

    def go(self) -> None:
        """Be called when the edge is at the next receiver."""
        self._agenda.at(self._steps[self._place][0], self._rank, self._node, self._arrive)

    def _arrive(self) -> None:
        steps, now_ns = self._steps, self._agenda.now_ns
        count = len(steps)
        while self._place < count:
            at_ns, call, arguments = steps[self._place]
            if at_ns > now_ns:
                if not self._agenda.goes_on_to(at_ns):
                    self.go()
                    return
                now_ns = at_ns
            self._place += 1
            self._agenda.handled += 1
            call(*arguments)
