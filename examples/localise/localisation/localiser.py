"""What one UA does in the mission, without aircraft and radio: readings and messages in, messages and plans out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from localisation.estimator import Area, Estimate, Estimator
from localisation.model import Floats, MeanPower, Reading, Spread, reading
from localisation.planner import Planner, PlannerSettings, Situation, Way, way_of
from localisation.wire import PART_MAX, PlannedPoint, Shared, SharedEstimate, pack, unpack


@dataclass(frozen=True, slots=True)
class Settings:
    """Of the mission, the same for all UA but for the planner's.

    Attributes:
        emitters: ids, each with the power that is believed of it, dBm.
        area: where they can be.
        planner: where and how this UA flies.
        reading_spacing_m: a reading counts once the UA is so far from where the one before was taken; fading and
            shadowing of readings in one place would bring nothing new.
        repeats: in how many messages after the first a reading is repeated.
    """

    emitters: Mapping[str, float]
    area: Area
    planner: PlannerSettings
    reading_spacing_m: float = 5.0
    repeats: int = 1


class Localiser:
    """One UA's knowledge of the emitters.

    Args:
        node: the UA's id.
        settings: of the mission.
        mean_power: mean reading at 0 dBm; from the sensor's calibration.
        spread: of readings about it.

    Attributes:
        emitters: ids, sorted: their order is that of the numbers in messages.
        told: newest estimates of each companion, for whoever looks; they are not fused, as they rest on the readings
            that are sent beside them.
        malformed: messages that could not be read.
    """

    def __init__(self, node: str, settings: Settings, mean_power: MeanPower, spread: Spread) -> None:
        self.node, self.settings = node, settings
        self.emitters = tuple(sorted(settings.emitters))
        self.told: dict[str, tuple[SharedEstimate, ...]] = {}
        self.malformed = 0
        self._planner = Planner(settings.planner, mean_power, spread)
        self._estimators = [
            Estimator(settings.area, _at_power(mean_power, settings.emitters[each]), spread)
            for each in self.emitters
        ]
        self._estimates: list[Estimate] | None = None
        self._taken: tuple[int, Floats] | None = None
        self._outbox: list[list[Reading]] = [[]]
        self._plans: dict[str, tuple[int, tuple[PlannedPoint, ...], float]] = {}
        self._plan: tuple[PlannedPoint, ...] = ()

    # --- what comes in

    def measured(
        self, number: int, emitter: str, sim_time_ns: int, place_ned_m: Sequence[float], power_dbm: float
    ) -> bool:
        """Take a reading of the UA's own sensor; False if it was too near to the one before, or of nobody known."""
        if emitter not in self.emitters:
            return False
        place = np.asarray(place_ned_m, dtype=float)
        if self._taken is None or number != self._taken[0]:
            if (
                self._taken is not None
                and np.linalg.norm(place - self._taken[1]) < self.settings.reading_spacing_m
            ):
                return False
            self._taken = (number, place)
        north, east, down = place.tolist()
        item = reading(number, self.emitters.index(emitter), sim_time_ns, (north, east, down), power_dbm)
        self._count(self.node, item)
        self._outbox[-1].append(item)
        return True

    def received(self, sender: str, payload: bytes) -> bool:
        """Take a companion's message; False, and counted, if it is none."""
        shared = unpack(payload)
        if shared is None or any(each.emitter >= len(self.emitters) for each in shared.readings):
            self.malformed += 1
            return False
        for each in shared.readings:
            self._count(sender, each)
        if shared.estimates:
            self.told[sender] = shared.estimates
        if shared.plan and shared.plan[0].sim_time_ns >= self._plans.get(sender, (-1, (), 0.0))[0]:
            self._plans[sender] = (shared.plan[0].sim_time_ns, shared.plan, self._down_m(sender))
        return True

    def _count(self, node: str, item: Reading) -> None:
        if self._estimators[item.emitter].add(node, item):
            self._estimates = None

    def _down_m(self, node: str) -> float:
        """How high a companion measured last; as high as this UA if it has sent nothing yet."""
        places = [each.places_ned_m(node) for each in self._estimators]
        known = [float(each[-1, 2]) for each in places if len(each)]
        return known[0] if known else -self.settings.planner.altitude_m

    # --- what is known, and goes out

    @property
    def estimates(self) -> list[Estimate]:
        """Of each emitter, in the order of `emitters`."""
        if self._estimates is None:
            self._estimates = [each.estimate() for each in self._estimators]
        return self._estimates

    def readings(self, node: str) -> int:
        """How many readings of a node count."""
        return sum(len(each.has(node)) for each in self._estimators)

    def message(self) -> bytes:
        """What to transmit now: new readings, those of the last messages again, estimates and the plan."""
        readings = [each for batch in self._outbox for each in batch][-PART_MAX:]
        self._outbox = [*self._outbox, []][-(self.settings.repeats + 1) :]
        estimates = tuple(
            SharedEstimate(i, *each.place_m.tolist(), *each.covariance_m2[[0, 0, 1], [0, 1, 1]].tolist())
            for i, each in enumerate(self.estimates)
        )
        return pack(Shared(tuple(readings), estimates[:PART_MAX], self._plan))

    def plan(self, sim_time_ns: int, place_m: Floats, course_rad: float) -> Way:
        """Choose a way from here, and send it with the messages to come."""
        ways = [
            (way_of(sim_time_ns, points), down_m) for _, (_, points, down_m) in sorted(self._plans.items())
        ]
        known = [(way, down_m) for way, down_m in ways if way is not None]
        own = np.concatenate([each.places_ned_m(self.node) for each in self._estimators])
        now = Situation(
            place_m,
            course_rad,
            self.estimates,
            own,
            [way for way, _ in known],
            [down_m for _, down_m in known],
        )
        way = self._planner.plan(now)
        self._plan = tuple(
            PlannedPoint(sim_time_ns + round(after_s * 1e9), *place.tolist())
            for after_s, place in zip(way.after_s.tolist(), way.places_m, strict=True)
        )
        return way


def _at_power(mean_power: MeanPower, power_dbm: float) -> MeanPower:
    return lambda emitters, places: mean_power(emitters, places) + power_dbm
