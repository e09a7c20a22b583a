"""Find RF emitters together: measure, transmit the readings, plan where to measure next.

lostlink run examples/localise/localise.yaml

docs/tutorial/localise.md says what it does and what it needs.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from localisation.estimator import Area, Estimate
from localisation.localiser import Localiser, Settings
from localisation.model import Floats, MeanPower, Spread
from localisation.planner import Fence, PlannerSettings, Way

from channel.sensing.sensor import Sensor
from lostlink import Agent, DecodeError, Measurement, Reception

CHANNEL = "localise"
LOOK_S = 1.0
"""How often the UA estimates, transmits and records."""


class Localise(Agent):
    """Options: see docs/tutorial/localise.md."""

    async def fly(self) -> None:
        self.localiser = localiser_of(self.ua.node, self.ua.sensor, self.options)
        self.is_fixed_wing = bool(self.options.get("fixed_wing", False))
        self.share = bool(self.options.get("share", True))
        self.telling = asyncio.create_task(self.tell())
        await self.take_off(self.options["altitude_m"])
        self.ua.report("searches")
        self.searching = asyncio.create_task(self.search())
        await self.sleep_until(self.options["until_s"])
        self.searching.cancel()
        self.telling.cancel()

    async def search(self) -> None:
        """Plan, and fly to the corner of the plan, until it is time to plan anew."""
        async for _ in self.every(self.options["replan_s"]):
            north_m, east_m, _ = self.ua.place_ned_m
            velocity = self.ua.state.velocity_ned_mps
            course_rad = math.atan2(velocity.y, velocity.x)
            way = self.localiser.plan(self.ua.sim_time_ns, np.array([north_m, east_m]), course_rad)
            self.flight = asyncio.create_task(self.fly_to(way))
            self.log(
                "plan", {"after_s": way.after_s, "north_m": way.places_m[:, 0], "east_m": way.places_m[:, 1]}
            )

    async def fly_to(self, way: Way) -> None:
        """Towards the way's corner; a newer plan takes over. Fixed wing take positions on the globe only."""
        north_m, east_m = way.places_m[1].tolist()
        altitude_m, speed_mps = self.options["altitude_m"], self.options["speed_mps"]
        if self.is_fixed_wing:
            place = self.ua.frames.earth_from_fleet((north_m, east_m, 0.0))
            await self.ua.goto(place.lat_deg, place.lon_deg, altitude_m, speed_mps=speed_mps)
        else:
            await self.ua.goto_ned(north_m, east_m, -altitude_m, frame="fleet", speed_mps=speed_mps)

    async def tell(self) -> None:
        """Estimate, record and transmit, once a second."""
        async for _ in self.every(LOOK_S):
            for emitter, estimate in zip(self.localiser.emitters, self.localiser.estimates, strict=True):
                self.log(f"estimate.{emitter}", told(estimate))
            if self.share:
                self.ua.transmit(CHANNEL, self.localiser.message())

    def on_measurement(self, measurement: Measurement) -> None:
        place = measurement.place_ned_m
        if place is None or measurement.emitter is None or not self.is_flying():
            return
        emitter, number, now_ns = measurement.emitter, measurement.number, measurement.sim_time_ns
        if self.localiser.measured(number, emitter, now_ns, place, measurement.power_dbm):
            self.log(
                "reading", {"emitter": emitter, "place_ned_m": place, "power_dbm": measurement.power_dbm}
            )

    def on_packet(self, sender: str, channel: str, payload: bytes, reception: Reception) -> None:
        super().on_packet(sender, channel, payload, reception)
        if channel == CHANNEL and not self.localiser.received(sender, payload):
            raise DecodeError(f"{len(payload)} bytes on {CHANNEL} are no message of the mission")

    def is_flying(self) -> bool:
        return self.ua.state is not None and self.ua.state.altitude_rel_m > 0.5 * self.options["altitude_m"]


def localiser_of(node: str, sensor: Sensor | None, options: Mapping[str, Any]) -> Localiser:
    """What the options and the sensor's calibration ask for.

    Raises:
        ValueError: the node has no sensor, or one that does not identify emitters by their ids.
    """
    if sensor is None or sensor.config.identifies != "id":
        raise ValueError(f"UA {node}: needs a sensor that identifies emitters by id")
    spread = spread_of(sensor, options.get("power_sigma_db", 0.0))
    area = Area(
        tuple(options["area"]["north_m"]), tuple(options["area"]["east_m"]), **options.get("grid", {})
    )
    fence = Fence(tuple(options["fence"]["north_m"]), tuple(options["fence"]["east_m"]))
    planner = PlannerSettings(
        fence,
        options["speed_mps"],
        options["altitude_m"],
        options["horizon_s"],
        height_m=area.height_m,
        **options.get("planner", {}),
    )
    more = {key: options[key] for key in ("reading_spacing_m", "repeats") if key in options}
    return Localiser(
        node, Settings(dict(options["emitters"]), area, planner, **more), mean_power_of(sensor), spread
    )


def mean_power_of(sensor: Sensor) -> MeanPower:
    """Mean reading at 0 dBm, by the sensor's calibration; the noise floor is far below."""
    mean_db, _ = sensor.fading_db

    def mean_power(emitters_ned_m: Floats, places_ned_m: Floats) -> Floats:
        return sensor.expected_power_dbm(emitters_ned_m, places_ned_m, power_dbm=mean_db)

    return mean_power


def spread_of(sensor: Sensor, power_sigma_db: float) -> Spread:
    """How its readings spread."""
    _, fading_db = sensor.fading_db
    step_db = sensor.config.step_db / math.sqrt(12.0)
    return Spread(
        sensor.shadowing_sigma_db, sensor.decorrelation_m, math.hypot(fading_db, step_db), power_sigma_db
    )


def told(estimate: Estimate) -> dict[str, Any]:
    """An estimate for the record."""
    north_m, east_m = estimate.place_m
    return {
        "north_m": north_m,
        "east_m": east_m,
        "covariance_m2": estimate.covariance_m2[[0, 0, 1], [0, 1, 1]],
        "readings": estimate.readings,
        "is_fine": estimate.is_fine,
    }
