"""What the methods of each kind of model have to give, and the few links with which a user's are tried when loaded."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import inf
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from channel.checks import FloatArray
from channel.geometry import Path, path_at
from channel.own.methods import LARGEST, Method, Numbers, OwnModelError, real_numbers
from channel.phy.error_model import Band

DISTANCES_M: Final = (10.0, 100.0, 1000.0)
HEIGHTS_M: Final = (2.0, 50.0)
LOSS_FROM_M: Final = 100.0
"""From here on a way takes power, whatever the law."""
FREQUENCY_HZ: Final = 2.4e9
BANDWIDTH_HZ: Final = 20e6
LENGTH_BYTES: Final = 40.0
PANELS: Final = 8
WEIGHTS_WITHIN: Final = 0.02
LEAST_M: Final = 0.001
LINKS: Final = 16
INSTANTS: Final = 1024
LONGEST_NS: Final = 1e14
MEAN_WITHIN: Final = 0.05
"""A mean loss may lie so far outside of all losses that were seen: what is rare may not be seen."""


def _few_links() -> Path:
    here = np.zeros((len(DISTANCES_M), 3))
    here[:, 2] = -HEIGHTS_M[0]
    there = np.array([(north_m, 0.0, -HEIGHTS_M[1]) for north_m in DISTANCES_M])
    return Path(FREQUENCY_HZ, np.linalg.norm(there - here, axis=1), *HEIGHTS_M, here, there)


def _among(first: ArrayLike, *others: ArrayLike) -> ArrayLike:
    """Return numbers in the shape that they have together with others."""
    shape = np.broadcast(first, *others).shape
    return first if np.shape(first) == shape else np.broadcast_to(first, shape)


def _distances_of(path: Path) -> ArrayLike:
    return _among(path.distance_m, path.frequency_hz, path.height_tx_m, path.height_rx_m)


@dataclass(frozen=True, slots=True)
class FadingRule:
    """`rule` of a fading: gains and weights, which are together 1."""

    def check(self, called: str, found: Any, given: tuple[Any, ...]) -> tuple[FloatArray, FloatArray]:
        """Return what it gave."""
        del given
        try:
            gains_db, weights = map(real_numbers, found)
        except (TypeError, ValueError):
            raise OwnModelError(f"{called} gave {found!r}: has to give gains and weights") from None
        if not (gains_db.max(initial=-inf) <= LARGEST and abs(weights).max(initial=0.0) <= LARGEST):
            raise OwnModelError(f"{called} gave {gains_db} dB with weights {weights}: have to be numbers")
        return gains_db, weights

    def tried(self, called: str, call: Callable[..., Any]) -> None:
        """Call it for a few elevations."""
        gains_db, weights = call(ELEVATIONS_DEG, PANELS)
        together = np.sum(
            np.broadcast_to(weights, np.broadcast_shapes(*map(np.shape, (gains_db, weights)))), -1
        )
        if not np.all(abs(together - 1.0) < WEIGHTS_WITHIN):
            raise OwnModelError(
                f"{called} gave weights that are {np.ravel(together)[0]:g} together: have to be 1"
            )


PATH: Final = _few_links()
SNRS_DB: Final = np.array([-20.0, 0.0, 5.0, 10.0, 60.0])
NORMAL: Final = np.array([-3.0, -0.5, 0.0, 0.5, 3.0])
UNIFORM: Final = np.array([0.001, 0.3, 0.5, 0.7, 0.999])
SCATTER: Final = np.array([0.001, 0.5j, 1.0 - 1.0j, -0.3 + 0.1j, 3.0])
DIRECT: Final = np.array([1.0, 1.0j, -1.0, -1.0j, 0.6 + 0.8j])
ELEVATIONS_DEG: Final = np.array([0.0, 10.0, 30.0, 60.0, 90.0])
DIRECTIONS_FRD: Final = np.array([(1.0, 0, 0), (0, 1, 0), (-1, 0, 0), (0, 0, 1), (0, 0.6, -0.8)])
BAND: Final = Band(BANDWIDTH_HZ, BANDWIDTH_HZ)
WORDS: Final = np.arange(1, LINKS + 1, dtype=np.uint64).repeat(INSTANTS) * np.uint64(0x9E3779B97F4A7C15)
TIMES_NS: Final = np.tile(np.geomspace(1e6, LONGEST_NS, INSTANTS).astype(np.int64), LINKS)

Methods = Mapping[str, Method]
PROPAGATION: Final[Methods] = {
    "path_loss_db": Numbers(
        (PATH,), "distance_m", _distances_of, hint=f"; a Path has {', '.join(Path._fields)}"
    )
}
SHADOWING: Final[Methods] = {
    "loss_db": Numbers((NORMAL,), "standard_normal", lambda normal: normal),
    "chance_below": Numbers((NORMAL,), "loss_db", lambda loss_db: loss_db, 0.0, 1.0),
}
FADING: Final[Methods] = {
    "gain_db": Numbers(
        (UNIFORM, UNIFORM[::-1], ELEVATIONS_DEG),
        "first draw",
        lambda first, second, _: _among(first, second),
        low=-inf,
    ),
    "gain_of_scatter_db": Numbers(
        (SCATTER, DIRECT, ELEVATIONS_DEG),
        "scatter",
        lambda scatter, direct, _: _among(scatter, direct),
        low=-inf,
    ),
    "rule": FadingRule(),
}
ANTENNA: Final[Methods] = {
    "towards_db": Numbers(
        (DIRECTIONS_FRD,), "direction_frd", lambda direction: direction, low=-inf, of_vectors=True
    )
}
NOISE: Final[Methods] = {
    "noise_floor_dbm": Numbers(
        (BANDWIDTH_HZ, FREQUENCY_HZ), "frequency_hz", lambda _, frequency_hz: frequency_hz
    ),
    "behind_cable_dbm": Numbers(
        (BANDWIDTH_HZ, FREQUENCY_HZ, 1.0), "frequency_hz", lambda _, frequency_hz, __: frequency_hz
    ),
}
ERROR: Final[Methods] = {
    "ber": Numbers((SNRS_DB, BAND), "snr_db", lambda snr_db, _: snr_db, 0.0, 1.0),
    "per": Numbers(
        (SNRS_DB, LENGTH_BYTES, BAND),
        "snr_db",
        lambda snr_db, length, _: _among(snr_db, length),
        0.0,
        1.0,
    ),
}
BURSTS: Final[Methods] = {
    "loss_at": Numbers((WORDS, TIMES_NS), "sim_time_ns", lambda _, times_ns: times_ns, 0.0, 1.0)
}


def try_losses(law: Any, label: str) -> None:
    """Try what path losses have to be beside numbers: positive, and of one link the same whatever the others.

    Raises:
        OwnModelError: they are not.
    """
    losses_db = np.asarray(law.path_loss_db(PATH))
    for row, (loss_db, distance_m) in enumerate(zip(losses_db, PATH.distance_m, strict=True)):
        where = f"{label}.path_loss_db gave {loss_db:.4g} dB at {distance_m:.4g} m"
        if distance_m >= LOSS_FROM_M and loss_db < 0.0:
            raise OwnModelError(f"{where}: a loss is positive")
        alone_db = float(law.path_loss_db(path_at(PATH, np.array([row])))[0])
        if not np.isclose(alone_db, loss_db, rtol=1e-9, atol=1e-9):
            raise OwnModelError(f"{where} among other links, and {alone_db:.4g} dB for that link alone")


def try_gain(law: Any, label: str) -> None:
    """Try whether the largest gain of a fading or shadowing is a number, if it says one.

    Raises:
        OwnModelError: it is none.
    """
    _try_number(f"{label}.max_gain_db", getattr(law, "max_gain_db", inf), -inf, inf)


def try_lasting(law: Any, label: str) -> None:
    """Try whether what a shadowing says of its extent can be.

    Raises:
        OwnModelError: it cannot.
    """
    try_gain(law, label)
    _try_number(f"{label}.spread_db", law.spread_db, 0.0, LARGEST)
    if law.decorrelation_m is not None:
        _try_number(f"{label}.decorrelation_m", law.decorrelation_m, LEAST_M, LARGEST)
    _try_number(f"{label}.shared_ends", getattr(law, "shared_ends", 0.0), 0.0, 0.5)
    if (surroundings := getattr(law, "surroundings", "own")) not in ("own", "shared"):
        raise OwnModelError(f"{label}.surroundings is {surroundings!r}: has to be own or shared")


def _try_number(called: str, found: object, low: float, high: float) -> None:
    if not (isinstance(found, int | float | np.number) and low <= found <= high):
        raise OwnModelError(f"{called} is {found!r}: has to be a number from {low:g} to {high:g}")


def try_mean_loss(bursts: Any, label: str) -> None:
    """Try whether the mean loss of bursts can be that of their losses.

    Raises:
        OwnModelError: it cannot.
    """
    mean = bursts.mean_loss
    if not (isinstance(mean, int | float | np.floating) and 0.0 <= mean <= 1.0):
        raise OwnModelError(f"{label}.mean_loss is {mean}: has to be from 0 to 1")
    losses = np.asarray(bursts.loss_at(WORDS, TIMES_NS))
    low, high = float(losses.min()), float(losses.max())
    if not low - MEAN_WITHIN <= mean <= high + MEAN_WITHIN or (mean == 0.0 < high):
        raise OwnModelError(
            f"{label}.mean_loss is {mean:g}, and loss_at gave {low:g} to {high:g} for {losses.size} packets"
        )
