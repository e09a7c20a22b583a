"""A UA beyond its station's range, whose reports others hand on.

lostlink run examples/ground_nodes/beyond_range.yaml

routes.parquet in the run directory has the way that each report took, and agents/gcs/heard.jsonl how old it was.
"""

from __future__ import annotations

from lostlink import Agent, GeodeticPosition, geodetic_from_ned

REPORT_PERIOD_NS = 250_000_000


class Scout(Agent):
    """Flies north and back, and sends its data packages to the station. Options: altitude_m, distance_m, speed_mps."""

    def transmit_package(self, sim_time_ns: int) -> None:
        if sim_time_ns % REPORT_PERIOD_NS == 0:
            self.ua.transmit(self.transmit_config.channel, self.package(sim_time_ns), to="gcs")

    async def fly(self) -> None:
        home = await self.take_off(self.options["altitude_m"])
        start = GeodeticPosition(home.latitude_deg, home.longitude_deg, home.altitude_amsl_m)
        for place in (geodetic_from_ned(start, (self.options["distance_m"], 0.0, 0.0)), start):
            is_there = await self.ua.goto(
                place.lat_deg, place.lon_deg, self.options["altitude_m"], speed_mps=self.options["speed_mps"]
            )
            if not is_there:  # an operator gave another target: the aircraft is theirs until it has landed
                self.ua.report("yields to another target")
                await self.ua.wait_for(lambda state: not state.armed)
                return


class Station(Agent):
    """Keeps what it hears of the scout."""

    def transmit_package(self, sim_time_ns: int) -> None:
        """It only listens."""

    def on_packet(self, sender, channel, payload, reception):
        super().on_packet(sender, channel, payload, reception)
        if sender == "0":
            self.record("heard", seq=reception.seq, delay_s=reception.delay_s)
