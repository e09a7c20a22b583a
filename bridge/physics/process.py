"""The flight dynamics process: hosts every UA's airframe, and keeps the fleet's time.

It begins to answer autopilots when the supervisor says that everybody is there (`clock/start`): an autopilot that runs
already (`autopilot: external`) must not fly through a tick that some agent has not heard of.
"""

from __future__ import annotations

import logging
import queue
import sys
from collections.abc import Sequence

from bridge.bus.session import open_client
from bridge.physics.flight_dynamics import FlownDynamics
from bridge.physics.on_bus import ClockOnBus
from bridge.record.events import Report
from bridge.run.directory import RunDirectory
from bridge.run.process import exit_status, on_stop_signal, parse_arguments
from bridge.timeouts import START_S
from fdm.errors import FdmError

log = logging.getLogger("physics")


def serve(run: RunDirectory) -> None:
    """Host the run's UA until a signal ends it."""
    with open_client(run.info.endpoint, run.credentials("physics"), timeout_s=START_S) as session:
        bus = ClockOnBus(session, run)
        on_stop_signal(sys.exit)  # by an exception, so that workers that have just been started are ended
        started: queue.SimpleQueue[bool] = queue.SimpleQueue()  # whose put takes no lock that a get may hold
        dynamics = FlownDynamics(run, Report(run.path, "physics"), bus)

        def stop() -> None:
            started.put(False)
            dynamics.stop()

        on_stop_signal(stop)
        session.subscribe(run.keys.clock_start, lambda _: started.put(True))
        bus.listen(dynamics.release)
        if run.scenario.lookahead_ticks:
            bus.listen_to_hosts(dynamics.exchanged)
        bus.hold(dynamics.exchange)
        session.declare_alive(run.keys.alive("physics"))
        log.info("serving UA on UDP ports %s", dynamics.exchange.ports)
        try:
            if started.get():
                dynamics.run()
        finally:
            bus.close()
            dynamics.close()


def main(words: Sequence[str] | None = None) -> int:
    """Run the process, with the words of its command line."""
    arguments = parse_arguments(words, "physics", __doc__ or "")
    try:
        return exit_status(lambda: serve(arguments.run))
    except FdmError as error:
        log.error("%s", error)
        return 1


if __name__ == "__main__":
    sys.exit(main())
