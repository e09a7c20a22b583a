"""Antennas: gain in the direction of the other end, in the aircraft's attitude."""

from __future__ import annotations

from typing import Literal, Protocol

from pydantic import Field

from channel.checks import FloatArray
from channel.variant import Variant


class AntennaModel(Protocol):
    """A gain pattern in the body frame (x forward, y right, z down)."""

    @property
    def needs_direction(self) -> bool:
        """Whether the gain depends on where the other end is."""
        ...

    def gain_db(self, direction_frd: FloatArray | None, /) -> FloatArray | float:
        """Return the gain in dB towards a unit vector in body axes, shape (..., 3) -> (...)."""
        ...


class Isotropic(Variant):
    """The same gain in every direction, whatever the attitude."""

    model: Literal["isotropic"] = "isotropic"
    gain: float = Field(default=0.0, alias="gain_db", description="gain in every direction")

    @property
    def needs_direction(self) -> bool:
        """False."""
        return False

    def gain_db(self, _direction_frd: FloatArray | None, /) -> float:
        """Return the gain as configured."""
        return self.gain
