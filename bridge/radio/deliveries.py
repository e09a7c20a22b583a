"""The record of the radio: `deliveries`, a row per packet and intended receiver, and the counters in `ledger.json`."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import TypeVar

from numpy.typing import ArrayLike

from bridge.record.tables.journal import TableWriter
from bridge.record.tables.schema import DELIVERIES
from channel.medium.ledger import Ledger
from channel.medium.reception import Fate

LEDGER = "ledger.json"
TRANSPORT = "transport"
"""Cause of loss: the packet left its agent and never came to the router. The host lost it, not the radio."""
TOO_LONG = "too_long"
"""Cause of loss: no radio of ours takes a packet of more than its largest length."""
FATES = (*(fate.value for fate in Fate), TRANSPORT, TOO_LONG)
"""What became of a packet at one receiver; rows have places in this."""


@dataclass(frozen=True, slots=True)
class DeliveryRow:
    """One row. What the channel never computed (a packet that the host lost, say) is NaN."""

    sim_time_ns: int
    tx: str
    rx: str
    seq: int
    length_bytes: int
    distance_m: float
    received_power_dbm: float
    snr_db: float
    per: float
    fate: str


class DeliveryColumns:
    """Writes what became of packets, a row per packet and intended receiver.

    Args:
        run: the run directory.
        nodes: ids of all nodes.
    """

    def __init__(self, run: Path, nodes: Sequence[str]) -> None:
        self._nodes = {node: place for place, node in enumerate(nodes)}
        self._fates = {fate: place for place, fate in enumerate(FATES)}
        self._writer = TableWriter(run, DELIVERIES, {"tx": nodes, "rx": nodes, "fate": FATES})
        self.flush, self.close = self._writer.flush, self._writer.close

    def append(
        self,
        rows: int,
        *,
        sim_time_ns: ArrayLike,
        tx: ArrayLike,
        rx: ArrayLike,
        seq: ArrayLike,
        length_bytes: ArrayLike,
        distance_m: ArrayLike,
        received_power_dbm: ArrayLike,
        snr_db: ArrayLike,
        per: ArrayLike,
        fate: ArrayLike,
    ) -> None:
        """Append rows: arrays of that length, or one value for all of them.

        Args:
            rows: how many.
            sim_time_ns: of transmission.
            tx: places in ``nodes``.
            rx: places in ``nodes``.
            seq: the senders' sequence numbers.
            length_bytes: as the error model counts it.
            distance_m: rounded to 1 mm; nan where the channel computed nothing, as in the next three.
            received_power_dbm: rounded to 0.001 dB.
            snr_db: rounded to 0.001 dB.
            per: rounded to 1e-7.
            fate: places in FATES.

        Raises:
            ValueError: an array has another length.
            TypeError: an array has numbers of another kind.
        """
        self._writer.append(
            rows,
            sim_time_ns=sim_time_ns,
            tx=tx,
            rx=rx,
            seq=seq,
            length_bytes=length_bytes,
            distance_m=distance_m,
            received_power_dbm=received_power_dbm,
            snr_db=snr_db,
            per=per,
            fate=fate,
        )

    def write(self, rows: Sequence[DeliveryRow]) -> None:
        """Append rows that are not yet columns."""
        if not rows:
            return
        columns = {name: [getattr(row, name) for row in rows] for name in DeliveryRow.__slots__}
        columns["tx"] = [self._nodes[node] for node in columns["tx"]]
        columns["rx"] = [self._nodes[node] for node in columns["rx"]]
        columns["fate"] = [self._fates[fate] for fate in columns["fate"]]
        self._writer.append(len(rows), **columns)


Refusal = TypeVar("Refusal", bound=StrEnum)


def write_ledger(
    path: Path,
    ledger: Ledger,
    refused: Mapping[Refusal, int],
    progress: Callable[[float], object] = lambda _: None,
) -> None:
    """Write the counters: per directed link, what was measured and predicted per bin, what was not taken.

    ``progress`` is told now and then which share of the bins is done.
    """
    links = [
        {"tx": tx, "rx": rx, "sent": a.sent, "delivered": a.delivered, "lost": dict(sorted(a.lost.items()))}
        for (tx, rx), a in sorted(ledger.links.items())
    ]
    bins = [
        {
            "tx": b.tx,
            "rx": b.rx,
            "distance_min_m": b.distance_min_m,
            "distance_max_m": b.distance_max_m,
            "sent": b.sent,
            "delivered": b.delivered,
            "measured": b.measured,
            "predicted": b.predicted,
            "ci99": [b.ci99_low, b.ci99_high],
        }
        for b in ledger.bins(progress)
    ]
    partial = path.with_suffix(".partial")
    partial.write_text(
        json.dumps(
            {"links": links, "bins": bins, "refused": {r.value: n for r, n in sorted(refused.items())}},
            indent=1,
        )
        + "\n",
        encoding="ascii",
    )
    partial.replace(path)
