"""A ground station: what it heard of each UA goes to agents/gcs/telemetry.jsonl in the run directory.

lostlink run examples/ground_nodes/ground_station.yaml
"""

from __future__ import annotations

from lostlink import Agent


class GroundStation(Agent):
    """Options: every_s (a line per UA), until_s (then its task is done)."""

    def transmit_package(self, sim_time_ns: int) -> None:
        """It only listens."""

    async def fly(self) -> None:
        async for now_s in self.every(self.options["every_s"]):
            for node in sorted(self.latest):
                package = self.latest[node]
                age_s = (self.ua.sim_time_ns - package.header.stamp.ns) / 1e9
                self.record("telemetry", ua=node, age_s=age_s, height_m=package.state.altitude_rel_m)
            self.ua.report(f"heard {', '.join(sorted(self.latest)) or 'nobody'}")
            if now_s >= self.options["until_s"]:
                return
