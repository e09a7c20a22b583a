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
from channel.link.decision import Signal
from channel.link.gain_law import chance_of_less
from channel.link.radio import Radio
from channel.link.steps import STEPS_PER_DB
from channel.medium.links import LinksOfPass

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
LEVEL = 2e-4
"""Of each check: with six that count, the verdict fails in one of a thousand runs with nothing wrong."""
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


class Judge:
    """Collects what a verdict needs, at the cost of a few sums per packet.

    Args:
        nodes: how many nodes there are.
    """

    def __init__(self, nodes: int) -> None:
        self._expected = np.zeros(MAX_BINS)
        self._variance = np.zeros(MAX_BINS)
        self._erased = np.zeros(MAX_BINS)
        self._packets = 0
        self._impossible = 0
        self._base_losses = 0
        self._base_packets = 0
        self._base_expected = 0.0
        self._base_variance = 0.0
        self._off_noise = 0
        self._places = _Places(nodes)

    def take(
        self,
        radio: Radio,
        links: LinksOfPass,
        mean_power_dbm: FloatArray,
        noise_dbm: FloatArray | float,
        signal: Signal,
        erased: NDArray[np.bool_],
    ) -> None:
        """Take in what was drawn on L links.

        Args:
            radio: whose law is judged, at both ends.
            links: the links; which of them are here may depend on their geometry, but on no draw.
            mean_power_dbm: of the link budget.
            noise_dbm: noise floor and interference that the radio has there; broadcasts.
            signal: as drawn, in whole steps.
            erased: whether the draw of the error model lost the packet.
        """
        per = signal.per
        self._packets += per.size
        index = np.minimum(links.distance_m * (1.0 / BIN_WIDTH_M), MAX_BINS - 1).astype(np.intp)
        spread = per * (1.0 - per)
        self._expected += np.bincount(index, per, MAX_BINS)
        self._variance += np.bincount(index, spread, MAX_BINS)
        self._erased += np.bincount(index, erased, MAX_BINS)
        noise_db = signal.received_power_dbm - signal.snr_db - noise_dbm
        self._off_noise += int(np.count_nonzero(np.abs(noise_db) > EXACT_DB))
        certain = spread == 0.0
        if certain.any():
            self._impossible += int(np.count_nonzero(erased[certain] != (per[certain] == 1.0)))
        self._places.take(radio, links, signal.received_power_dbm - mean_power_dbm)

    def take_base_losses(self, radio: Radio, lost: NDArray[np.bool_]) -> None:
        """Take in which packets the base loss of a radio lost, shape (L,)."""
        share = radio.config.base_loss
        self._base_packets += lost.size
        self._base_expected += lost.size * share
        self._base_variance += lost.size * share * (1.0 - share)
        self._base_losses += int(np.count_nonzero(lost))

    def verdict(self) -> Verdict:
        """Return what there is to say by now."""
        checks = [*self._draws(), *self._places.checks()]
        checks += self._base()
        return Verdict(tuple(checks))

    def _base(self) -> list[Check]:
        if self._base_variance < LEAST_VARIANCE:
            return []
        z = (self._base_losses - self._base_expected) / math.sqrt(self._base_variance)
        return [Check("base loss", self._base_packets, z, 2.0 * float(special.ndtr(-abs(z))))]

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
            checks.append(
                Check("losses by distance", bins, float(off.sum()), float(special.chdtrc(bins, off.sum())))
            )
        return checks


class _Places:
    """Powers at places far from each other, each as where in its law it lies."""

    def __init__(self, nodes: int) -> None:
        self._judged = {shared: _judged_links(nodes, disjoint=shared) for shared in (False, True)}
        self._next_ns = np.zeros(nodes * nodes, dtype=np.int64)
        self._nodes = nodes
        self._seen: dict[int, list[FloatArray]] = {}
        self._off = 0
        self._exact = 0
        self._normal: list[float] = []

    def take(self, radio: Radio, links: LinksOfPass, gain_db: FloatArray) -> None:
        config = radio.config
        link = links.tx * self._nodes + links.rx
        shared = getattr(config.shadowing, "shared_ends", 0.0) > 0.0
        judged = np.flatnonzero(self._judged[shared][link])
        if not judged.size:
            return
        if not (config.shadowing.is_random or config.fading.is_random or radio.sight is not None):
            self._exact += judged.size
            self._off += int(np.count_nonzero(np.abs(gain_db[judged]) > EXACT_DB))
            return
        when_ns = links.sim_time_ns[judged]
        due = judged[when_ns >= self._next_ns[link[judged]]]
        apart_m = _apart_m(radio)
        rows = [row for row in due.tolist() if self._is_new(links, row, int(link[row]), apart_m)]
        if rows:
            at = np.array(rows, dtype=np.intp)
            normal = special.ndtri(chance_of_less(radio, links.at(at).path, gain_db[at]))
            self._normal += np.clip(normal, -FARTHEST, FARTHEST).tolist()

    def _is_new(self, links: LinksOfPass, row: int, link: int, apart_m: float) -> bool:
        """Return whether a link is far from all places where it was judged before; if so, keep the place."""
        when_ns = int(links.packets.sim_time_ns[links.packet[row]])
        if when_ns < self._next_ns[link]:
            return False  # an earlier packet of the same pass was taken
        self._next_ns[link] = when_ns + APART_NS
        seen = self._seen.setdefault(link, [])
        if len(seen) >= MAX_PLACES:
            return False
        assert links.path.position_tx_ned_m is not None
        assert links.path.position_rx_ned_m is not None
        here = np.stack((links.path.position_tx_ned_m[row], links.path.position_rx_ned_m[row]))
        if apart_m > 0.0 and seen:
            moved_m = np.sqrt(np.sum(np.square(np.array(seen) - here), axis=-1)).sum(axis=-1)
            if moved_m.min() < apart_m:
                return False
        seen.append(here)
        return True

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


def _apart_m(radio: Radio) -> float:
    """Return how far the ends have to move for lasting terms to be drawn anew, nearly."""
    shadowing = radio.config.shadowing
    lasting_m = [
        shadowing.decorrelation_m if shadowing.is_random else None,
        None if radio.sight is None else radio.sight.decorrelation_m,
    ]
    return APART * max((each for each in lasting_m if each is not None), default=0.0)


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


def text_of(checks: Sequence[Check]) -> str:
    """Return checks in one line for people: those that failed, or how many there were."""
    failed = [
        f"{check.name} (1 in {1.0 / max(check.chance, 1e-12):.0f})" for check in checks if not check.passed
    ]
    return ", ".join(failed) if failed else f"{len(checks)} checks"
