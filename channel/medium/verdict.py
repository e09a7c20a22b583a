"""Whether a run's packets are what its radio says: the draws given the fading, and the fading given its law.

Packets of a link that follow each other see the same shadowing: they are not so many independent trials of the
averaged probability of delivery. So two questions are asked. Whether each packet was lost with the error rate of its
own drawn power: these draws are independent, whatever the fading. And whether the powers follow their law: judged at
places so far apart that the random terms there are nearly independent.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from channel import special
from channel.checks import FloatArray
from channel.geometry import Path
from channel.link.gain_law import chance_of_less
from channel.link.radio import Radio
from channel.link.steps import STEPS_PER_DB

BIN_WIDTH_M = 20.0
MAX_BINS = 8192
LEAST_VARIANCE = 5.0
"""Of a count of losses, below which it is not taken for normal."""
LEAST_PLACES = 8
APART = 3.0
"""Places are so many decorrelation distances apart."""
APART_NS = 2_000_000_000
"""Between powers of one pair that are judged, so that fading has changed, too."""
MAX_PAIRS = 128
MAX_PLACES = 400
"""Of one pair."""
LEVEL = 1e-3
"""Of each check: with at most six the verdict fails in 0.6 % of runs with nothing wrong."""
EXACT_DB = 2.0 / STEPS_PER_DB
FARTHEST = 8.0


class Check(NamedTuple):
    """One question about a run.

    Attributes:
        name: what is judged.
        size: of how many packets, or places.
        found: the statistic.
        chance: of one at least as far off, if nothing is wrong.
    """

    name: str
    size: int
    found: float
    chance: float

    @property
    def passed(self) -> bool:
        """Whether the chance is not below the level."""
        return self.chance >= LEVEL


@dataclass(frozen=True, slots=True)
class Verdict:
    """What the checks say together; a run too short for any of them says nothing."""

    checks: tuple[Check, ...]

    @property
    def judged(self) -> bool:
        """Whether there is anything to judge."""
        return bool(self.checks)

    @property
    def passed(self) -> bool:
        """Whether all checks passed."""
        return all(check.passed for check in self.checks)


class Heard(NamedTuple):
    """L links on which a signal was drawn, as columns.

    Attributes:
        tx: transmitting node, index.
        rx: receiving node, index.
        sim_time_ns: when the packet was sent.
        path: the geometry, with positions of shape (L, 3).
        distance_m: between the ends.
        mean_power_dbm: of the link budget.
        received_power_dbm: with the drawn terms, in whole steps.
        snr_db: likewise.
        noise_dbm: noise floor and interference that the radio has there; broadcasts.
        per: packet error rate at the drawn power.
        erased: whether the draw of the error model lost the packet.
        base_loss: whether the base loss did, or would have; None: there is no base loss.
    """

    tx: NDArray[np.intp]
    rx: NDArray[np.intp]
    sim_time_ns: NDArray[np.int64]
    path: Path
    distance_m: FloatArray
    mean_power_dbm: FloatArray
    received_power_dbm: FloatArray
    snr_db: FloatArray
    noise_dbm: FloatArray | float
    per: FloatArray
    erased: NDArray[np.bool_]
    base_loss: NDArray[np.bool_] | None


class Judge:
    """Collects what a verdict needs, at the cost of a few sums per packet.

    Args:
        radio: whose law is judged.
        nodes: how many nodes there are.
    """

    def __init__(self, radio: Radio, nodes: int) -> None:
        self._radio = radio
        self._expected = np.zeros(MAX_BINS)
        self._variance = np.zeros(MAX_BINS)
        self._erased = np.zeros(MAX_BINS)
        self._packets = 0
        self._impossible = 0
        self._base_losses = 0
        self._off_noise = 0
        self._places = _Places(radio, nodes)

    def take(self, heard: Heard) -> None:
        """Take in what became of packets."""
        self._packets += len(heard.per)
        index = np.minimum(heard.distance_m * (1.0 / BIN_WIDTH_M), MAX_BINS - 1).astype(np.intp)
        spread = heard.per * (1.0 - heard.per)
        self._expected += np.bincount(index, heard.per, MAX_BINS)
        self._variance += np.bincount(index, spread, MAX_BINS)
        self._erased += np.bincount(index, heard.erased, MAX_BINS)
        noise_db = heard.received_power_dbm - heard.snr_db - heard.noise_dbm
        self._off_noise += int(np.count_nonzero(np.abs(noise_db) > EXACT_DB))
        certain = spread == 0.0
        if certain.any():
            self._impossible += int(np.count_nonzero(heard.erased[certain] != (heard.per[certain] == 1.0)))
        if heard.base_loss is not None:
            self._base_losses += int(np.count_nonzero(heard.base_loss))
        self._places.take(heard)

    def verdict(self) -> Verdict:
        """Return what there is to say by now."""
        checks = [*self._draws(), *self._places.checks()]
        base_loss = self._radio.config.base_loss
        if base_loss * (1.0 - base_loss) * self._packets >= LEAST_VARIANCE:
            low = float(special.bdtr(self._base_losses, self._packets, base_loss))
            high = (
                float(special.bdtrc(self._base_losses - 1, self._packets, base_loss))
                if self._base_losses
                else 1.0
            )
            share = self._base_losses / self._packets
            checks.append(Check("base loss", self._packets, share, min(1.0, 2.0 * min(low, high))))
        return Verdict(tuple(checks))

    def _draws(self) -> list[Check]:
        if not self._packets:
            return []
        checks = [
            Check(name, self._packets, float(wrong), float(wrong == 0))
            for name, wrong in (("certain fates", self._impossible), ("noise", self._off_noise))
        ]
        total = float(self._variance.sum())
        if total >= LEAST_VARIANCE:
            z = float((self._erased - self._expected).sum()) / math.sqrt(total)
            checks.append(Check("losses", self._packets, z, 2.0 * float(special.ndtr(-abs(z)))))
        enough = self._variance >= LEAST_VARIANCE
        bins = int(np.count_nonzero(enough))
        if bins > 1:
            off = np.square(self._erased - self._expected)[enough] / self._variance[enough]
            checks.append(Check("losses by distance", bins, float(off.sum()), _chance_of_chi2(off, bins)))
        return checks


def _chance_of_chi2(off: FloatArray, bins: int) -> float:
    return float(special.chdtrc(bins, off.sum()))


class _Places:
    """Powers at places far from each other, each as where in its law it lies."""

    def __init__(self, radio: Radio, nodes: int) -> None:
        config = radio.config
        lasting_m = [config.shadowing.decorrelation_m if config.shadowing.is_random else None]
        lasting_m.append(None if radio.sight is None else radio.sight.decorrelation_m)
        self._radio = radio
        self._apart_m = APART * max((each for each in lasting_m if each is not None), default=0.0)
        self._is_random = config.shadowing.is_random or config.fading.is_random or radio.sight is not None
        self._is_judged = _judged_links(nodes, disjoint=getattr(config.shadowing, "shared_ends", 0.0) > 0.0)
        self._next_ns = np.zeros(nodes * nodes, dtype=np.int64)
        self._nodes = nodes
        self._seen: dict[int, list[FloatArray]] = {}
        self._off = 0
        self._exact = 0
        self._normal: list[float] = []

    def take(self, heard: Heard) -> None:
        link = heard.tx * self._nodes + heard.rx
        judged = np.flatnonzero(self._is_judged[link])
        if not judged.size:
            return
        if not self._is_random:
            gain_db = heard.received_power_dbm[judged] - heard.mean_power_dbm[judged]
            self._exact += judged.size
            self._off += int(np.count_nonzero(np.abs(gain_db) > EXACT_DB))
            return
        due = judged[heard.sim_time_ns[judged] >= self._next_ns[link[judged]]]
        rows = [row for row in due.tolist() if self._is_new(heard, row, int(link[row]))]
        if rows:
            self._judge(heard, np.array(rows, dtype=np.intp))

    def _is_new(self, heard: Heard, row: int, link: int) -> bool:
        """Return whether a link is far from all places where it was judged before; if so, keep the place."""
        when_ns = int(heard.sim_time_ns[row])
        if when_ns < self._next_ns[link]:
            return False  # an earlier packet of the same pass was taken
        self._next_ns[link] = when_ns + APART_NS
        seen = self._seen.setdefault(link, [])
        if len(seen) >= MAX_PLACES:
            return False
        assert heard.path.position_tx_ned_m is not None
        assert heard.path.position_rx_ned_m is not None
        here = np.stack((heard.path.position_tx_ned_m[row], heard.path.position_rx_ned_m[row]))
        if self._apart_m > 0.0 and seen:
            moved_m = np.sqrt(np.sum(np.square(np.array(seen) - here), axis=-1)).sum(axis=-1)
            if moved_m.min() < self._apart_m:
                return False
        seen.append(here)
        return True

    def _judge(self, heard: Heard, rows: NDArray[np.intp]) -> None:
        path = _path_at(heard.path, rows, len(heard.tx))
        gain_db = heard.received_power_dbm[rows] - heard.mean_power_dbm[rows]
        normal = special.ndtri(chance_of_less(self._radio, path, gain_db))
        self._normal += np.clip(normal, -FARTHEST, FARTHEST).tolist()

    def checks(self) -> list[Check]:
        if self._exact:
            return [
                Check("powers without random terms", self._exact, float(self._off), float(self._off == 0))
            ]
        count = len(self._normal)
        if count < LEAST_PLACES:
            return []
        normal = np.array(self._normal)
        z = float(normal.mean()) * math.sqrt(count)
        around = float(np.square(normal - normal.mean()).sum())
        low, high = float(special.chdtr(count - 1, around)), float(special.chdtrc(count - 1, around))
        return [
            Check("level of the powers", count, z, 2.0 * float(special.ndtr(-abs(z)))),
            Check("spread of the powers", count, around / (count - 1), min(1.0, 2.0 * min(low, high))),
        ]


def _judged_links(nodes: int, *, disjoint: bool) -> NDArray[np.bool_]:
    """Return which links are judged, by number: one direction of each of some pairs, spread over the nodes.

    Args:
        nodes: how many there are.
        disjoint: whether no node may be in two pairs.
    """
    judged = np.zeros(nodes * nodes, dtype=bool)
    count = 0
    for step in range(1, nodes):
        for tx in range(nodes):
            rx = tx + step
            if rx >= nodes or count >= MAX_PAIRS or (disjoint and (step > 1 or tx % 2)):
                continue
            judged[tx * nodes + rx] = True
            count += 1
        if count >= MAX_PAIRS:
            break
    return judged


def _path_at(path: Path, rows: NDArray[np.intp], links: int) -> Path:
    """Return the geometry of some links."""
    return Path._make(None if column is None else _at(column, rows, links) for column in path)


def _at(column: FloatArray | float, rows: NDArray[np.intp], links: int) -> FloatArray:
    array = np.asarray(column)
    if array.ndim and array.shape[0] == links:
        return array[rows]
    return np.broadcast_to(array, (links, *array.shape))[rows]


def text_of(checks: Sequence[Check]) -> str:
    """Return checks in one line for people: those that failed, or how many there were."""
    failed = [
        f"{check.name} (1 in {1.0 / max(check.chance, 1e-12):.0f})" for check in checks if not check.passed
    ]
    return ", ".join(failed) if failed else f"{len(checks)} checks"
