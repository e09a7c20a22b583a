"""The flight dynamics process: hosts every UA's airframe, and keeps the fleet's time."""

from __future__ import annotations

import logging
import sys

from bridge.bus.messages import DecodeError, Header, decode
from bridge.bus.session import Sample, Session, open_client
from bridge.physics.truth_message import clock_message, truth_message
from bridge.run.directory import RunDirectory
from bridge.run.process import exit_status, on_stop_signal, parse_arguments
from bridge.scenario.model import Scenario
from bridge.scenario.resolve import airframe_of, disturb_of, home_of, legacy_of, origin_of, wind_of
from fdm.air.weather import in_weather
from fdm.errors import FdmError
from fdm.exchange.aircraft_spec import AircraftSpec
from fdm.exchange.exchange import Exchange
from fdm.workers.fleet_exchange import FleetExchange, open_exchange

log = logging.getLogger("physics")


def exchange_of(scenario: Scenario, session: Session, run: RunDirectory) -> Exchange | FleetExchange:
    """The exchange of a scenario, publishing truth and clock."""
    keys, origin = run.keys, origin_of(scenario.origin)
    wind = wind_of(scenario)
    specs = [
        AircraftSpec(
            ua.id,
            in_weather(airframe_of(ua), scenario.weather, home_of(ua, scenario.origin)),
            home_of(ua, scenario.origin),
            scenario.fdm_port(ua),
            wind.build(seed=scenario.seed, ua_id=ua.id),
            disturb_of(scenario, ua),
            legacy_of(scenario, ua),
        )
        for ua in scenario.ua
    ]
    return open_exchange(
        specs,
        workers=scenario.fdm.workers,
        coupling=scenario.fdm.coupling,
        speed=scenario.speed_factor,
        tick_period_ns=scenario.tick_period_ns,
        hold_ticks=True,
        on_truth=lambda truth: session.put(
            keys.truth(str(truth.ua_id)), truth_message(truth, origin), must_arrive=True
        ),
        on_tick=lambda status: session.put(keys.clock, clock_message(status), must_arrive=True),
    )


def serve(run: RunDirectory) -> None:
    """Host the run's UA until a signal ends it."""
    with open_client(run.info.endpoint) as session:
        exchange = exchange_of(run.scenario, session, run)

        def on_release(sample: Sample) -> None:
            try:
                exchange.release_tick(decode(sample.payload.to_bytes(), Header).stamp.ns)
            except DecodeError as error:
                log.warning("%s", error)

        on_stop_signal(exchange.stop)
        session.subscribe(run.keys.clock_release, on_release)
        session.declare_alive(run.keys.alive("physics"))
        log.info("serving UA on UDP ports %s", exchange.ports)
        try:
            exchange.run()
        finally:
            exchange.close()


def main() -> int:
    """Run the process."""
    run, _ = parse_arguments("physics", __doc__ or "", per_ua=False)
    try:
        return exit_status(lambda: serve(run))
    except FdmError as error:
        log.error("%s", error)
        return 1


if __name__ == "__main__":
    sys.exit(main())
