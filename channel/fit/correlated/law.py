"""What is searched when shadowing is correlated: the parameters that the integral over the shadowing is given."""

from __future__ import annotations

from typing import NamedTuple


class Law(NamedTuple):
    """What the integral is conditional on.

    Attributes:
        sigma_db: of the shadowing.
        decorrelation_m: of the shadowing.
        scatter_db: standard deviation of a reading about the power of its place: the receiver's error, or fading.
        floor_dbm: noise floor.
        base_loss: losses that do not depend on the power.
    """

    sigma_db: float
    decorrelation_m: float
    scatter_db: float
    floor_dbm: float
    base_loss: float
