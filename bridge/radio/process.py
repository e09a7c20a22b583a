"""The router process: Zenoh's router and, in its session, the virtual radio."""

from __future__ import annotations

import json
import logging
import queue
import sys
from collections.abc import Iterable
from functools import partial

from bridge.bus.identity.logins import LoginWatch
from bridge.bus.keys import KeyMistake, Keys
from bridge.bus.messages import (
    AgentStatus,
    Clock,
    CommandEvent,
    DataPackage,
    DecodeError,
    Header,
    RadioSwitch,
    Truths,
    decode,
    encoding_of,
)
from bridge.bus.replies import reply_event
from bridge.bus.session import Query, Sample, Session, Stamp, open_router
from bridge.radio.deliveries import LEDGER, DeliveryColumns, write_ledger
from bridge.radio.intake import Handler, Intake, Waiting
from bridge.radio.measurements import SensorsOfRun
from bridge.radio.publisher import TickPublisher
from bridge.radio.ring import Ring
from bridge.radio.senders import Refused
from bridge.radio.virtual_radio import Settled, VirtualRadio
from bridge.record import names
from bridge.record.events import Report
from bridge.record.packets import SentPacket, encode_packet
from bridge.record.radio_switches import switches_of
from bridge.record.streams import StreamWriter
from bridge.run.directory import RunDirectory
from bridge.run.every import Every
from bridge.run.process import exit_status, log_clock, on_stop_signal, parse_arguments
from bridge.scenario.resolve.radio import radios_of
from bridge.scenario.resolve.sensing import emitters_of, sensors_of
from bridge.timeouts import FLUSH_PERIOD_S
from channel.medium.medium import Medium
from channel.medium.verdict import Judge
from channel.validity import OutsideValidityError

IDLE_S = 5.0
NO_PACKAGE = "no_data_package_on_the_data_channel"
"""Counter, with the sender's id behind it: of packets that agents would keep as data packages, and cannot read."""
PACKAGE_ENCODING = encoding_of(DataPackage)
REFUSALS_LOGGED_MAX = 20
log = logging.getLogger("router")


class RouterProcess:
    """Moves samples between Zenoh and the core, in one thread and in the order in which they came."""

    def __init__(self, session: Session, run: RunDirectory, report: Report) -> None:
        scenario, keys = run.scenario, run.keys
        emitters = emitters_of(scenario)
        radios = radios_of(scenario, emitters)
        self._keys: Keys = keys
        self._session = session
        self._run = run
        ring = Ring(
            scenario.regulated,
            tasks=scenario.nodes_with_a_task,
            end_ns=round(scenario.duration_s * 1e9),
            tick_period_ns=scenario.tick_period_ns,
        )
        self._judge = Judge(len(scenario.transceiver_ids))
        medium = Medium(
            radios,
            seed=scenario.seed,
            nodes=scenario.transceiver_ids,
            judge=self._judge,
            emitters=[each.name for each in emitters],
            switches=switches_of(scenario),
        )
        mtu_bytes = {node: radio.config.mtu_bytes for node, radio in radios.items()}
        self._core = VirtualRadio(medium, ring, mtu_bytes)
        self._publisher = TickPublisher(session, keys, scenario.transceiver_ids, run.info.hosts)
        self._free = {node.node for node in scenario.transceivers if not node.has_agent}
        self._report = report
        self._data_channel = scenario.transmit.channel
        self._packets = {
            node: StreamWriter(names.packets(node).path(run.path)) for node in scenario.transceiver_ids
        }
        self._writer = DeliveryColumns(run.path, scenario.transceiver_ids)
        self._sensors = SensorsOfRun.of(run, sensors_of(scenario), emitters, medium)
        self._intake = Intake()
        droppable = {self._on_packet, self._on_agent}
        for key_expr, handler in self._handlers():
            push = partial(self._intake.push, handler, may_drop=handler in droppable)
            session.subscribe(key_expr, push)
        for node in scenario.transceivers:
            on_asked = self._on_asked_as_free if not node.has_agent else self._on_asked_beside_an_agent
            push = partial(self._intake.push, on_asked, may_drop=False)
            session.serve(keys.next_packet(node.node), push)

    def _handlers(self) -> Iterable[tuple[str, Handler]]:
        yield self._keys.tick("truths"), self._on_truths
        yield self._keys.tx("*", "*", to="*", radio="*"), self._on_packet
        yield self._keys.radio("*"), self._on_switch
        yield self._keys.answer("*"), self._on_answer
        yield self._keys.clock, self._on_clock
        yield self._keys.agent("*"), self._on_agent

    def stop(self) -> None:
        """End `run`; callable from a signal handler."""
        self._intake.end()

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
            self._write(self._core.finish())
        finally:
            self._close_files()
        self._tell_overload()
        self._report.close()
        checks = self._judge.verdict().checks
        write_ledger(
            self._run.path / LEDGER, self._core.ledger, self._core.refused, self._tell_progress, checks
        )

    def _close_files(self) -> None:
        self._writer.close()
        if self._sensors is not None:
            self._sensors.close()
        for writer in self._packets.values():
            writer.close()

    def _tell_overload(self) -> None:
        if self._intake.dropped:
            self._core.refused[Refused.OVERLOAD] += self._intake.dropped
            self._report.may_not_repeat(
                f"{self._intake.dropped} packets came faster than the radio took them"
            )
        elif self._core.refused[Refused.OVERLOAD]:
            self._report.may_not_repeat("a node transmitted more packets in a tick than the radio takes")

    def _tell_progress(self, share: float) -> None:
        """Tell the supervisor, which waits as long as it hears of progress."""
        header = Header.at(0, f"writes its record: {100 * share:.0f} % of the distance bins")
        self._session.put(self._keys.ending, header, must_arrive=True)

    def _serve(self) -> None:
        flush, idle_s = Every(FLUSH_PERIOD_S), 0.0
        while True:
            try:
                item = self._intake.get(FLUSH_PERIOD_S)
                if item is None:
                    return
                self._handle(item)
                idle_s = 0.0
            except queue.Empty:
                idle_s += FLUSH_PERIOD_S
                if idle_s == IDLE_S:
                    self._tell_what_is_waited_for()
            if flush.is_due():
                self._flush()

    def _flush(self) -> None:
        self._writer.flush()
        if self._sensors is not None:
            self._sensors.flush()
        for writer in self._packets.values():
            writer.flush()
        self._report.flush()

    def _tell_what_is_waited_for(self) -> None:
        nodes = self._core.ring.waiting_for
        if nodes:
            log.warning("nodes %s have not answered the latest tick", ", ".join(nodes))
        else:
            log.warning("all nodes have answered the latest tick: the flight dynamics wait for an autopilot")

    def _handle(self, item: Waiting) -> None:
        for key, seq in item.lost.items():
            self._core.on_dropped(self._keys.node_of(key), seq)
        try:
            item.handler(str(item.came.key_expr), item.came)
        except (
            DecodeError,
            KeyMistake,
        ) as error:  # bytes or keys of somebody else's; what is ours ends the run
            self._core.refused[Refused.MALFORMED] += 1
            self._tell_refusal(f"{item.came.key_expr}: {error}")

    def _tell_refusal(self, text: str) -> None:
        if self._core.refused.total() <= REFUSALS_LOGGED_MAX:
            log.warning("refused %s; refused so far: %s", text, dict(self._core.refused))

    # What comes.

    def _on_truths(self, _key: str, sample: Sample) -> None:
        self._core.on_truths(decode(sample.payload.to_bytes(), Truths).truth)

    def _on_packet(self, key: str, sample: Sample) -> None:
        address, payload = self._keys.address_of(key), sample.payload.to_bytes()
        encoding = str(sample.encoding)
        if self._core.on_packet(address, payload, encoding, Stamp.from_sample(sample)):
            self._tell_if_free(address.node)
            if address.channel == self._data_channel and not _is_package(payload, encoding):
                self._report.count(f"{NO_PACKAGE}.{address.node}")
        else:
            self._tell_refusal(f"a packet on {key}")

    def _tell_if_free(self, node: str) -> None:
        """What a node that the clock does not wait for does, it does by wall time."""
        if node in self._free:
            self._free.discard(node)
            text = f"a program that the clock does not wait for transmits as node {node}"
            self._report.may_not_repeat(text)

    def _on_clock(self, _key: str, sample: Sample) -> None:
        log_clock.now_ns = decode(sample.payload.to_bytes(), Clock).header.stamp.ns
        self._core.on_tick(log_clock.now_ns)

    def _on_agent(self, key: str, sample: Sample) -> None:
        node, status = self._keys.node_of(key), decode(sample.payload.to_bytes(), AgentStatus)
        self._core.on_sent_total(node, status.sent)
        self._tell_if_free(node)
        if status.failed:
            self._core.ring.end()
        if status.done:
            self._core.ring.done(node)

    def _on_asked_as_free(self, key: str, query: Query) -> None:
        """A free node's program asks how to go on; all that the one before it transmitted has been taken."""
        stamp = self._core.next_packet(self._keys.node_of(key))
        value = json.dumps({"seq": stamp.seq, "sim_time_ns": stamp.sim_time_ns})
        reply_event(query, key, CommandEvent(CommandEvent.RESULT, True, value=value))

    def _on_asked_beside_an_agent(self, key: str, query: Query) -> None:
        node = self._keys.node_of(key)
        text = f"node {node} has an agent that is not free, which alone transmits and numbers its packets"
        reply_event(query, key, CommandEvent(CommandEvent.RESULT, False, text, outcome="refused"))

    def _on_switch(self, key: str, sample: Sample) -> None:
        switch = decode(sample.payload.to_bytes(), RadioSwitch)
        node, sim_time_ns = self._keys.node_of(key), switch.header.stamp.ns
        self._core.on_switch(node, sim_time_ns, on=switch.on)
        log.info("an operator switched the radio of node %s %s", node, "on" if switch.on else "off")

    def _on_answer(self, key: str, sample: Sample) -> None:
        sim_time_ns = decode(sample.payload.to_bytes(), Header).stamp.ns
        closed = self._core.on_answer(self._keys.node_of(key), sim_time_ns)
        if closed is None:
            return
        header = Header.at(closed.sim_time_ns, "")
        if not closed.is_tick:
            self._session.put(self._keys.clock_release, header, must_arrive=True)
            return
        settled = self._core.settle()
        told = self._sensors.measure(closed.sim_time_ns) if self._sensors is not None else ()
        self._publisher.to_nodes(closed.sim_time_ns, settled, told)
        release = self._keys.clock_end if closed.is_end else self._keys.clock_release
        self._session.put(release, header, must_arrive=True)
        core = self._core
        self._publisher.to_observers(
            closed.sim_time_ns, settled, core.ledger, core.radios_off, is_end=closed.is_end
        )
        self._write(settled)

    # The record.

    def _write(self, settled: Settled) -> None:
        self._writer.write(settled)
        transmitted, self._core.transmitted = self._core.transmitted, []
        for packet in transmitted:
            sent = SentPacket(packet.seq, packet.sim_time_ns, packet.address, packet.payload)
            self._packets[self._core.nodes[packet.tx]].write(packet.sim_time_ns, encode_packet(sent))


def _is_package(payload: bytes, encoding: str) -> bool:
    """Whether a packet is a data package: by what it is said to be, or else by its bytes."""
    if encoding == PACKAGE_ENCODING:
        return True
    try:
        decode(payload, DataPackage)
    except DecodeError:
        return False
    return True


def login_refused(report: Report, reason: str, number: int) -> None:
    """Count a login that the router refused, and log the first ones."""
    report.count(f"logins_refused_{reason}")
    if number <= REFUSALS_LOGGED_MAX:
        log.warning("refused a login (%s)", reason)


def serve(run: RunDirectory) -> None:
    """Route for the run until a signal ends it."""
    report = Report(run.path, "router")
    with LoginWatch(partial(login_refused, report)), open_router(run.info.endpoint, run.guard) as session:
        process = RouterProcess(session, run, report)
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
