"""Whether what a flight model says can be: an autopilot that is fed nonsense dies of it.

A contact that JSBSim integrates badly throws the aircraft back harder than it came. The ground does no work, so that an
impact leaves no more speed than there was; what turned may move on, which is what the margin is for.
"""

from __future__ import annotations

from collections.abc import Callable
from math import hypot

from fdm.errors import ModelDivergedError

Sense = Callable[[], tuple[float, ...]]

RATE_MAX_RADPS = 300.0
"""48 turns per second. What tumbles after the hardest crash of an airframe that ships has 123 rad/s."""
FORCE_MAX_MPS2 = 50_000.0
"""5000 g; the hardest crash has 500 g."""
SPEED_MAX_MPS = 1000.0
"""Three times that of sound."""
DEPTH_MAX_M = 10.0
"""Below home, on whose level the ground is: no contact held it."""
IMPACT_MPS2 = 300.0
"""30 g: no motor does that, and no air."""
IMPACT_GAIN_MAX_MPS = 10.0
"""What an impact may add to the speed: half a metre from the centre of gravity that is 20 rad/s come to rest."""


def plausible(sense: Sense) -> Sense:
    """`sense`, a model's function of that name, with a look at what it gives.

    Returns:
        A function that gives the same numbers. It raises ModelDivergedError, which says what is wrong, if one is not
        finite, beyond its range, or if an impact made the aircraft faster.
    """
    before_mps, in_impact = 0.0, False

    def checked() -> tuple[float, ...]:
        nonlocal before_mps, in_impact
        values = sense()
        rate, force, speed = hypot(*values[0:3]), hypot(*values[3:6]), hypot(*values[12:15])
        # A NaN compares false, so that it fails here too.
        if not (rate <= RATE_MAX_RADPS and force <= FORCE_MAX_MPS2 and speed <= SPEED_MAX_MPS):
            raise ModelDivergedError(
                f"the flight model gave {speed:.3g} m/s, {rate:.3g} rad/s, {force:.3g} m/s^2: it has diverged"
            )
        if not values[8] <= DEPTH_MAX_M:
            raise ModelDivergedError(
                f"the flight model gave a place {values[8]:.3g} m below the ground: it has no contact that holds it"
            )
        impact = force > IMPACT_MPS2
        # A force is of this frame and the speed that it makes of the next one.
        if (impact or in_impact) and speed > before_mps + IMPACT_GAIN_MAX_MPS:
            raise ModelDivergedError(
                f"the flight model gave {speed:.3g} m/s after an impact at {before_mps:.3g} m/s: "
                "its ground contact has diverged"
            )
        if not impact:
            before_mps = speed
        in_impact = impact
        return values

    return checked
