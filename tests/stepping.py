"""A flight model without flight: it stands, and writes down what drives it."""

from __future__ import annotations

from fdm.model.air_point import AirPoint, StaticAir
from fdm.model.truth import TrueState, Vector
from fdm.wire.servo_packet import Fields


class SteppingModel:
    """Stands at its home; ``driven`` gets the fields of each step."""

    def __init__(self, driven: list[Fields]) -> None:
        self._driven = driven

    def sense(self) -> tuple[float, ...]:
        """At rest."""
        return (0.0, 0.0, 0.0, 0.0, 0.0, -9.8, *(0.0,) * 10)

    def step(self, fields: Fields, rate_hz: int) -> None:
        """Write it down."""
        self._driven.append(fields)

    def air(self) -> StaticAir:
        """That at sea level."""
        return StaticAir(101_325.0, 288.15)

    def truth(self, ua_id: int, sim_time_ns: int) -> TrueState:
        """It stands."""
        still = (0.0, 0.0, 0.0)
        level = (1.0, 0.0, 0.0, 0.0)
        return TrueState(
            ua_id, sim_time_ns, 47.3977, 8.5456, 488.0, still, still, level, still, still, 0.0, still
        )

    def air_point(self, sim_time_ns: int) -> AirPoint:
        """Where it stands."""
        return AirPoint(sim_time_ns, 47.3977, 8.5456, 488.0, 0.0, (0.0, 0.0, 0.0))

    def set_wind(self, wind_ned_mps: Vector) -> None:
        """It feels none."""
