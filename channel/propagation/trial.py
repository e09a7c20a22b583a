"""A law of a user's own is tried on a few links when it is loaded: before anything flies with it."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from channel.checks import ChannelInputError
from channel.geometry import Path
from channel.validity import OutsideValidityError

DISTANCES_M: Final = (10.0, 100.0, 1000.0)
HEIGHTS_M: Final = (2.0, 50.0)
FREQUENCY_HZ: Final = 2.4e9


def try_law(law: Any) -> None:
    """Ask a law for three links, 10 to 1000 m over the ground, twice.

    Raises:
        ValueError: it raises, gives something else than a loss in dB per link, or another one the second time. A law
            that does not hold for such links is not tried.
    """
    here = np.zeros((len(DISTANCES_M), 3))
    here[:, 2] = -HEIGHTS_M[0]
    there = np.array([(north_m, 0.0, -HEIGHTS_M[1]) for north_m in DISTANCES_M])
    path = Path(FREQUENCY_HZ, np.linalg.norm(there - here, axis=1), *HEIGHTS_M, here, there)
    try:
        losses_db = [law.path_loss_db(path) for _ in range(2)]
    except (ChannelInputError, OutsideValidityError):
        return
    except Exception as error:
        raise ValueError(
            f"path_loss_db raises {type(error).__name__} for three links: {error}; a Path has {', '.join(Path._fields)}"
        ) from error
    first, second = losses_db
    if np.shape(first) != path.distance_m.shape:
        raise ValueError(
            f"path_loss_db gives {np.shape(first) or 'one number'} for three links: it has to give an array, one loss "
            "in dB for each of path.distance_m"
        )
    if not np.isfinite(np.asarray(first, dtype=float)).all():
        raise ValueError(f"path_loss_db gives {first} dB at {DISTANCES_M} m: has to be finite")
    if not np.array_equal(first, second):
        raise ValueError(
            "path_loss_db gives another loss for the same links the second time: what is random is drawn elsewhere"
        )
