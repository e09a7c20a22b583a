"""The process of a host: aircraft bridges and agents of its nodes, between Zenoh and the autopilots' MAVLink."""

from __future__ import annotations

import asyncio
import logging
import sys
from collections.abc import Callable, Sequence
from contextlib import AsyncExitStack
from functools import partial

from bridge.agents.bus_outlet import BusOutlet
from bridge.bus.inbox import Inbox
from bridge.bus.messages import Clock, DecodeError, Header, Heard, decode
from bridge.bus.session import Sample, Session, open_client
from bridge.host.arrivals import hand_out, hand_out_serial
from bridge.host.hosted import Hosted, hosted_node, stop_all
from bridge.host.hosted_node import HostedNode
from bridge.host.offspring import Offspring
from bridge.host.on_bus import AskedOnBus
from bridge.record.events import Report
from bridge.run.directory import RunDirectory
from bridge.run.process import Arguments, parse_arguments, run_until_stopped
from bridge.timeouts import START_S

log = logging.getLogger("host")
_Came = tuple[Callable[[Sample], None], Sample]
"""Who handles what came."""


async def run_host(run: RunDirectory, name: str, nodes: tuple[str, ...], stop: asyncio.Event) -> None:
    """Serve until ``stop`` is set."""
    report = Report(run.path, name)
    with open_client(run.info.endpoint, run.credentials(name), timeout_s=START_S) as session:
        async with AsyncExitStack() as stack:
            stack.callback(Offspring(report).end)
            hosted = [hosted_node(run, node, BusOutlet(session, run.keys, node)) for node in nodes]
            for one in hosted:
                await stack.enter_async_context(one)
            listener = _Listener(run, name, hosted, report)
            listener.listen(session)
            session.declare_alive(run.keys.alive(name))
            await stop.wait()
            stop_all(hosted)
            report.count("samples_whose_handling_failed", listener.inbox.failed)
            report.close()


class _Listener:
    """Hands what comes on Zenoh to the event loop, in one order over all keys."""

    def __init__(self, run: RunDirectory, name: str, hosted: Sequence[HostedNode], report: Report) -> None:
        self._run, self._keys, self._name = run, run.keys, name
        self._stations = run.scenario.transceiver_ids
        self._networks = run.scenario.network_names
        self._hosted = Hosted(hosted, self._exchanged)
        self._arrivals = {one.id: one.node.arrivals for one in hosted}
        self._report = report
        # Without a limit: the ring bounds what comes between two ticks, and a packet that was delivered stays so.
        self.inbox: Inbox[_Came] = Inbox(asyncio.get_running_loop(), self._dispatch, limit=None)

    def listen(self, session: Session) -> None:
        """Subscribe."""
        self._session = session
        for one in self._hosted.nodes:
            AskedOnBus(session, self._run, one)
        session.subscribe(self._keys.heard(self._name), partial(self._push, self._heard_came))
        session.subscribe(self._keys.clock, partial(self._push, self._clock_came))
        session.subscribe(self._keys.clock_exchange, partial(self._push, self._exchange_came))

    def _exchanged(self, sim_time_ns: int) -> None:
        header = Header.at(sim_time_ns, self._name)
        self._session.put(self._keys.exchanged(self._name), header, must_arrive=True)

    def _push(self, handler: Callable[[Sample], None], sample: Sample) -> None:
        self.inbox.push((handler, sample))

    def _dispatch(self, item: _Came) -> None:
        handler, sample = item
        try:
            handler(sample)
        except DecodeError as error:
            self._report.count("malformed_samples")
            log.warning("%s: %s", sample.key_expr, error)

    def _heard_came(self, sample: Sample) -> None:
        heard = decode(sample.payload.to_bytes(), Heard)
        hand_out(heard, self._stations, self._arrivals, self._networks)
        hand_out_serial(heard, self._stations, self._hosted.serial_came, self._networks)

    def _clock_came(self, sample: Sample) -> None:
        clock = decode(sample.payload.to_bytes(), Clock)
        self._hosted.hold(clock.header.stamp.ns, is_tick=True, stalled=clock.stalled)

    def _exchange_came(self, sample: Sample) -> None:
        self._hosted.hold(decode(sample.payload.to_bytes(), Header).stamp.ns, is_tick=False)


def main(words: Sequence[str] | None = None) -> int:
    """Run the process, with the words of its command line."""
    arguments: Arguments = parse_arguments(words, "host", __doc__ or "", has_nodes=True)
    return run_until_stopped(lambda stop: run_host(arguments.run, arguments.name, arguments.nodes, stop))


if __name__ == "__main__":
    sys.exit(main())
