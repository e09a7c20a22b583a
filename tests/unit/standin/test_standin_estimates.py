"""What the stand-in tells of the wind, from frames whose wind is known."""

from __future__ import annotations

from math import hypot

import pytest

from standin.vehicle.estimates import WindEstimate, true_per_equivalent
from standin.wire.sensors import AT_REST

DRAG_PER_S = 0.3


@pytest.mark.parametrize(
    ("alt_m", "ratio"), [(0.0, 1.0), (1000.0, 1.0498), (4000.0, 1.2229), (11_000.0, 1.8347), (2e4, 1.8347)]
)
def test_true_airspeed_of_the_standard_atmosphere(alt_m: float, ratio: float) -> None:
    """ISO 2533: densities of 1.225, 1.1117, 0.81935 and 0.36392 kg/m^3."""
    assert true_per_equivalent(alt_m) == pytest.approx(ratio, abs=2e-4)


@pytest.mark.parametrize("alt_m", [0.0, 4000.0])
@pytest.mark.parametrize("wind_mps", [(3.0, 0.0), (-5.0, 6.2)])
@pytest.mark.parametrize("velocity_mps", [(0.0, 0.0, 0.0), (0.0, 0.0, -2.5), (4.0, -2.0, 1.5)])
def test_the_wind_is_found_at_any_height_climbing_or_not(
    alt_m: float, wind_mps: tuple[float, float], velocity_mps: tuple[float, float, float]
) -> None:
    air = (wind_mps[0] - velocity_mps[0], wind_mps[1] - velocity_mps[1], -velocity_mps[2])
    true_mps = hypot(*air)
    frame = AT_REST._replace(
        velocity_ned_mps=velocity_mps,
        specific_force_mps2=(DRAG_PER_S * air[0], DRAG_PER_S * air[1], -9.80665),
        airspeed_mps=true_mps / true_per_equivalent(alt_m),
    )
    wind = WindEstimate()
    for _ in range(6000):
        wind.step(frame, alt_m, 0.01)
    assert (wind.north_mps, wind.east_mps) == pytest.approx(wind_mps, abs=1e-3)
