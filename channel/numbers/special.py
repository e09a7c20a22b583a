"""`scipy.special`, imported when its first function is asked for: that takes a quarter of a second.

Every process of a run reads scenarios, and with them radios; only that of the radio computes with them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from scipy.special import (
        bdtr,
        bdtrc,
        betaincinv,
        binom,
        chdtr,
        chdtrc,
        chdtri,
        chndtr,
        erfc,
        gammainc,
        gammaincc,
        gammainccinv,
        gammaincinv,
        i0e,
        j0,
        ndtr,
        ndtri,
    )

__all__ = [
    "bdtr",
    "bdtrc",
    "betaincinv",
    "binom",
    "chdtr",
    "chdtrc",
    "chdtri",
    "chndtr",
    "erfc",
    "gammainc",
    "gammaincc",
    "gammainccinv",
    "gammaincinv",
    "i0e",
    "j0",
    "ndtr",
    "ndtri",
]


def __getattr__(name: str) -> object:
    """Take a function from scipy, and keep it."""
    if name not in __all__:
        raise AttributeError(f"module 'channel.numbers.special' has no attribute {name!r}")
    import scipy.special

    globals()[name] = function = getattr(scipy.special, name)
    return function
