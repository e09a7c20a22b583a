"""What the deliveries of a run show: shares, ages, losses."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bridge.bus.keys import ALL
from bridge.record.reading.ages import received_ns, sawtooth
from bridge.record.tables.parquet import read_table
from bridge.record.tables.schema import DELIVERIES
from bridge.scenario.expectations import AgeExpectation, DeliveryExpectation
from bridge.scenario.model import Scenario

DECIMALS_S = 9
COLUMNS = ("sim_time_ns", "tx", "rx", "packets", "distance_m", "fate")
FATES = ("delivered", "transport")
"""What is looked for: heard, and lost before the radio."""
DELIVERED, BY_HOST = range(len(FATES))
Mask = NDArray[np.bool_]


class PacketFinder:
    """Looks into `deliveries` of a run, which are read when they are first asked for.

    Args:
        run: its directory.
        scenario: what was flown.
    """

    def __init__(self, run: Path, scenario: Scenario) -> None:
        self._run, self._nodes = run, scenario.transceiver_ids
        self._tick_ns = scenario.tick_period_ns

    @cached_property
    def _rows(self) -> dict[str, NDArray[Any]]:
        """The table with names as numbers: nodes in their order, then ``all``; fates as in `FATES`, others -1."""
        names = {"tx": self._nodes, "rx": (*self._nodes, ALL), "fate": FATES}
        parts: dict[str, list[NDArray[Any]]] = {name: [] for name in COLUMNS}
        for batch in read_table(self._run, DELIVERIES, COLUMNS):
            for name in COLUMNS:
                values = batch[name]
                parts[name].append(_numbers(values, names[name]) if name in names else values)
        return {name: np.concatenate(values) if values else np.empty(0) for name, values in parts.items()}

    def shares(self, wanted: DeliveryExpectation) -> list[float]:
        """Delivered per sent: of all packets that are meant together, or of each link; nothing if none was sent."""
        if not wanted.each_link:
            return self._share(wanted, wanted.from_, wanted.to)
        senders = self._nodes if wanted.from_ is None else (wanted.from_,)
        receivers = self._nodes if wanted.to is None else (wanted.to,)
        return [
            share for tx in senders for rx in receivers if tx != rx for share in self._share(wanted, tx, rx)
        ]

    def _share(self, wanted: DeliveryExpectation, tx: str | None, rx: str | None) -> list[float]:
        chosen = self._of(tx, rx) & self._between(wanted.between_s)
        if wanted.distance_m is not None:
            low, high = wanted.distance_m
            chosen &= (self._rows["distance_m"] >= low) & (self._rows["distance_m"] <= high)
        packets = self._rows["packets"] * self._receivers(rx)
        sent = packets[chosen].sum()
        delivered = packets[chosen & (self._rows["fate"] == DELIVERED)].sum()
        return [float(delivered / sent)] if sent else []

    def age_s(self, wanted: AgeExpectation, end_s: float) -> float | None:
        """The greatest age of information (`bridge.record.reading.ages`); from the interval's begin if none came.

        Args:
            wanted: of what.
            end_s: sim time at which the run ended.
        """
        begin_s, until_s = wanted.between_s or (0.0, end_s)
        until_s = min(until_s, end_s)
        if until_s <= begin_s:
            return None
        senders = [wanted.from_] if wanted.from_ else [node for node in self._nodes if node != wanted.node]
        ages = [self._greatest_age_s(tx, wanted.node, begin_s, until_s) for tx in senders if tx is not None]
        return max(ages, default=None)

    def _greatest_age_s(self, tx: str, rx: str, begin_s: float, until_s: float) -> float:
        heard = self._of(tx, rx) & (self._rows["fate"] == DELIVERED)
        generated_ns, came_ns = self._rows["sim_time_ns"][heard], self._received_ns[heard]
        age = sawtooth(generated_ns, came_ns, round(begin_s * 1e9), round(until_s * 1e9)).age
        return round(age.peak_s, DECIMALS_S)

    @cached_property
    def _received_ns(self) -> NDArray[np.int64]:
        return received_ns(self._rows["sim_time_ns"].astype(np.int64), self._tick_ns)

    def lost_by_host(self) -> int:
        """Packets that never got to the radio, once per receiver."""
        lost = self._rows["fate"] == BY_HOST
        return int((self._rows["packets"] * self._receivers(None))[lost].sum())

    def _of(self, tx: str | None, rx: str | None) -> Mask:
        """Rows of a sender and receiver; None: any. Those for everybody are for each receiver, too."""
        rows = self._rows
        chosen = np.ones(len(rows["tx"]), dtype=np.bool_)
        if tx is not None:
            chosen &= rows["tx"] == self._nodes.index(tx)
        if rx is not None:
            here = self._nodes.index(rx)
            chosen &= (rows["rx"] == here) | ((rows["rx"] == len(self._nodes)) & (rows["tx"] != here))
        return chosen

    def _receivers(self, rx: str | None) -> NDArray[Any]:
        """How many receivers each row stands for, of those that are meant."""
        others = len(self._nodes) - 1 if rx is None else 1
        return np.where(self._rows["rx"] == len(self._nodes), others, 1)

    def _between(self, interval_s: tuple[float, float] | None) -> Mask:
        times_ns = self._rows["sim_time_ns"]
        if interval_s is None:
            return np.ones(len(times_ns), dtype=np.bool_)
        return (times_ns >= interval_s[0] * 1e9) & (times_ns <= interval_s[1] * 1e9)


def _numbers(values: NDArray[Any], names: tuple[str, ...]) -> NDArray[Any]:
    found, where = np.unique(values.astype(str), return_inverse=True)
    numbers = np.array(
        [names.index(name) if name in names else -1 for name in found.tolist()], dtype=np.int64
    )
    return numbers[where]
