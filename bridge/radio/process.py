"""The router process: Zenoh's router and, in its session, the virtual radio."""

from __future__ import annotations

import logging
import queue
import sys
import threading
from collections.abc import Callable, Iterable

from bridge.bus.keys import Keys
from bridge.bus.messages import AgentStatus, Clock, Header, Truth, decode
from bridge.bus.session import Sample, Session, Stamp, open_router
from bridge.radio.deliveries import DELIVERIES, LEDGER, DeliveriesWriter, write_ledger
from bridge.radio.virtual_radio import Action, Forward, Refused, VirtualRadio
from bridge.record import names
from bridge.record.events import Report
from bridge.record.packets import SentPacket, encode_packet
from bridge.record.streams import StreamWriter
from bridge.run.directory import RunDirectory
from bridge.run.every import Every
from bridge.run.process import exit_status, on_stop_signal, parse_arguments
from bridge.scenario.resolve_radio import radio_of
from bridge.timeouts import FLUSH_PERIOD_S
from channel.medium.medium import Medium
from channel.validity import OutsideValidityError

IDLE_S = 5.0
REFUSALS_LOGGED_MAX = 20
QUEUE_MAX = 200_000
"""Samples that may wait; more packets than that are dropped and counted, as a host that cannot keep up drops them."""
log = logging.getLogger("router")
Handler = Callable[[str, Sample], list[Action]]


class RouterProcess:
    """Moves samples between Zenoh and the core, in one thread and in the order in which they came."""

    def __init__(self, session: Session, run: RunDirectory) -> None:
        scenario, keys = run.scenario, run.keys
        self._keys: Keys = keys
        self._session = session
        self._run = run
        medium = Medium(radio_of(scenario), seed=scenario.seed, nodes=scenario.nodes)
        self._core = VirtualRadio(
            keys,
            medium,
            scenario.nodes,
            tasks=scenario.nodes_with_a_task,
            end_ns=round(scenario.duration_s * 1e9),
            tick_period_ns=scenario.tick_period_ns,
        )
        self._report = Report(run.path, "router")
        self._packets = {node: StreamWriter(names.packets(node).path(run.path)) for node in scenario.nodes}
        self._writer = DeliveriesWriter(run.path / DELIVERIES)
        self._queue: queue.SimpleQueue[tuple[Handler, Sample] | None] = queue.SimpleQueue()
        self._overload = 0
        self._overload_lock = threading.Lock()
        for key_expr, handler in self._handlers():
            session.subscribe(key_expr, lambda sample, handler=handler: self._enqueue(handler, sample))  # type: ignore[misc]

    def _enqueue(self, handler: Handler, sample: Sample) -> None:
        """Called in Zenoh's threads."""
        if handler == self._on_packet and self._queue.qsize() >= QUEUE_MAX:
            with self._overload_lock:
                self._overload += 1
        else:
            self._queue.put((handler, sample))

    def _handlers(self) -> Iterable[tuple[str, Handler]]:
        yield self._keys.truth("*"), self._on_truth
        yield self._keys.tx("*", "*", to="*", radio="*"), self._on_packet
        yield self._keys.answer("*"), self._on_answer
        yield self._keys.clock, self._on_clock
        yield self._keys.agent("*"), self._on_agent

    def stop(self) -> None:
        """End `run`; callable from a signal handler."""
        self._queue.put(None)

    def run(self) -> None:
        """Serve until `stop`, then write what is left of the record, however long that takes."""
        finish = self._finish
        try:
            self._serve()
        except OutsideValidityError:  # the packet has no fate: the books cannot be closed
            finish = self._close_files
            raise
        finally:
            finish()

    def _finish(self) -> None:
        try:
            self._perform(self._core.finish())
        finally:
            self._close_files()
        if self._overload:
            self._core.refused[Refused.OVERLOAD] += self._overload
            self._report.may_not_repeat(f"{self._overload} packets came faster than the radio took them")
        if self._core.refused[Refused.OVERLOAD] and not self._overload:
            self._report.may_not_repeat("a node transmitted more packets in a tick than the radio takes")
        self._report.close()
        write_ledger(self._run.path / LEDGER, self._core.ledger, self._core.refused, self._tell_progress)

    def _close_files(self) -> None:
        self._writer.close()
        for writer in self._packets.values():
            writer.close()

    def _tell_progress(self, share: float) -> None:
        """Tell the supervisor, which waits as long as it hears of progress."""
        header = Header.at(0, f"writes its record: {100 * share:.0f} % of the distance bins")
        self._session.put(self._keys.ending, header, must_arrive=True)

    def _serve(self) -> None:
        flush, idle_s = Every(FLUSH_PERIOD_S), 0.0
        while True:
            try:
                item = self._queue.get(timeout=FLUSH_PERIOD_S)
                if item is None:
                    return
                self._handle(*item)
                idle_s = 0.0
            except queue.Empty:
                idle_s += FLUSH_PERIOD_S
                if idle_s == IDLE_S:
                    self._tell_what_is_waited_for()
            if flush.is_due():
                self._flush()

    def _flush(self) -> None:
        self._writer.flush()
        for writer in self._packets.values():
            writer.flush()
        self._report.flush()

    def _tell_what_is_waited_for(self) -> None:
        nodes = self._core.waiting_for
        if nodes:
            log.warning("nodes %s have not answered the latest tick", ", ".join(nodes))
        else:
            log.warning("all nodes have answered the latest tick: the flight dynamics wait for an autopilot")

    def _handle(self, handler: Handler, sample: Sample) -> None:
        try:
            actions = handler(str(sample.key_expr), sample)
        except OutsideValidityError:  # the radio's own: the run ends
            raise
        except ValueError as error:  # bytes that are no message, or numbers that no radio can work with
            self._refuse(Refused.MALFORMED, f"{sample.key_expr}: {error}")
            return
        self._perform(actions)

    def _refuse(self, reason: Refused, text: str) -> None:
        self._core.refused[reason] += 1
        if self._core.refused[reason] <= REFUSALS_LOGGED_MAX:
            log.warning("refused (%s): %s", reason.value, text)

    def _perform(self, actions: Iterable[Action]) -> None:
        for action in actions:
            if isinstance(action, Forward):
                packet = action.packet
                self._session.put_bytes(
                    action.key,
                    packet.payload,
                    encoding=packet.encoding,
                    attachment=action.attachment,
                    must_arrive=True,
                )
            else:
                self._session.put(action.key, action.message, must_arrive=action.must_arrive)
        self._writer.write(self._core.settled)
        self._core.settled.clear()
        for packet in self._core.transmitted:
            sent = SentPacket(packet.seq, packet.sim_time_ns, packet.channel, packet.payload)
            self._packets[packet.tx].write(packet.sim_time_ns, encode_packet(sent))
        self._core.transmitted.clear()

    def _on_truth(self, key: str, sample: Sample) -> list[Action]:
        truth = decode(sample.payload.to_bytes(), Truth)
        q = truth.attitude
        return self._core.on_truth(
            self._keys.last_chunk(key), truth.header.stamp.ns, truth.position_ned_m.xyz, (q.w, q.x, q.y, q.z)
        )

    def _on_packet(self, key: str, sample: Sample) -> list[Action]:
        to = self._keys.address_of(key)
        refused = self._core.refused.total()
        self._core.on_packet(
            to.node, to.channel, sample.payload.to_bytes(), sample.encoding, Stamp.from_sample(sample)
        )
        if self._core.refused.total() == refused + 1 <= REFUSALS_LOGGED_MAX:
            log.warning("refused a packet on %s; refused so far: %s", key, dict(self._core.refused))
        return []

    def _on_answer(self, key: str, sample: Sample) -> list[Action]:
        return self._core.on_answer(
            self._keys.node_of(key), decode(sample.payload.to_bytes(), Header).stamp.ns
        )

    def _on_clock(self, _key: str, sample: Sample) -> list[Action]:
        self._core.on_tick(decode(sample.payload.to_bytes(), Clock).header.stamp.ns)
        return []

    def _on_agent(self, key: str, sample: Sample) -> list[Action]:
        status = decode(sample.payload.to_bytes(), AgentStatus)
        self._core.on_sent_total(self._keys.node_of(key), status.sent)
        if status.failed:
            self._core.on_failed()
        if status.done:
            self._core.on_done(self._keys.node_of(key))
        return []


def serve(run: RunDirectory) -> None:
    """Route for the run until a signal ends it."""
    with open_router(run.info.endpoint) as session:
        process = RouterProcess(session, run)
        on_stop_signal(process.stop)
        session.declare_alive(run.keys.alive("router"))
        log.info("routing run %s at %s", run.info.run, run.info.endpoint)
        process.run()


def main() -> int:
    """Run the process."""
    arguments = parse_arguments("router", __doc__ or "")
    return exit_status(lambda: serve(arguments.run))


if __name__ == "__main__":
    sys.exit(main())
