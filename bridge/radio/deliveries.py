"""The record of the radio: `deliveries`, a row per packet and intended receiver, and the counters in `ledger.json`."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from enum import StrEnum
from pathlib import Path
from typing import TypeVar

from numpy.typing import ArrayLike

from bridge.bus.keys import ALL
from bridge.radio.senders import Cause, Gap
from bridge.radio.virtual_radio import Settled
from bridge.record.tables.journal import TableWriter
from bridge.record.tables.schema import DELIVERIES
from channel.medium import reception as medium
from channel.medium.ledger import Ledger
from channel.medium.reception import EVERYBODY
from channel.medium.verdict import Check

LEDGER = "ledger.json"
FATES = (*(fate.value for fate in medium.FATES), *(cause.value for cause in Cause))
"""What became of a packet at one receiver; rows have places in this."""


class DeliveryColumns:
    """Writes what became of packets, a row per packet and intended receiver.

    Args:
        run: the run directory.
        nodes: ids of all nodes.
    """

    def __init__(self, run: Path, nodes: Sequence[str]) -> None:
        self.everybody = len(nodes)
        labels = {"tx": nodes, "rx": (*nodes, ALL), "fate": FATES}
        self._writer = TableWriter(run, DELIVERIES, labels)
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
        packets: ArrayLike = 1,
    ) -> None:
        """Append rows: arrays of that length, or one value for all of them.

        Args:
            rows: how many.
            sim_time_ns: of transmission.
            tx: places in ``nodes``.
            rx: places in ``nodes``, or ``everybody``.
            seq: the senders' sequence numbers.
            length_bytes: as the error model counts it.
            distance_m: rounded to 1 mm; nan where the channel computed nothing, as in the next three.
            received_power_dbm: rounded to 0.001 dB.
            snr_db: rounded to 0.001 dB.
            per: rounded to 1e-7.
            fate: places in FATES.
            packets: how many a row stands for: those that were lost together have one.

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
            packets=packets,
        )

    def write(self, settled: Settled) -> None:
        """Append what became of packets: a row for each reception, and one for packets that were lost together."""
        r, p = settled.receptions, settled.receptions.packets
        self.append(
            len(r.rx),
            sim_time_ns=p.sim_time_ns[r.packet],
            tx=p.tx[r.packet],
            rx=r.rx,
            seq=p.seq[r.packet],
            length_bytes=settled.counted_bytes[r.packet],
            distance_m=r.distance_m,
            received_power_dbm=r.received_power_dbm,
            snr_db=r.snr_db,
            per=r.per,
            fate=r.fate,
        )
        for gap in settled.gaps:
            self._write_gap(gap)

    def _write_gap(self, gap: Gap) -> None:
        self.append(
            1,
            sim_time_ns=gap.sim_time_ns,
            tx=gap.tx,
            rx=self.everybody if gap.to == EVERYBODY else gap.to,
            seq=gap.first_seq,
            packets=gap.packets,
            length_bytes=gap.length_bytes,
            distance_m=math.nan,
            received_power_dbm=math.nan,
            snr_db=math.nan,
            per=math.nan,
            fate=FATES.index(gap.cause.value),
        )


Refusal = TypeVar("Refusal", bound=StrEnum)


def write_ledger(
    path: Path,
    ledger: Ledger,
    refused: Mapping[Refusal, int],
    progress: Callable[[float], object] = lambda _: None,
    checks: Iterable[Check] = (),
) -> None:
    """Write the counters: per directed link, what was measured and predicted per bin, what was not taken, checks.

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
            {
                "links": links,
                "bins": bins,
                "refused": {r.value: n for r, n in sorted(refused.items())},
                "checks": [check._asdict() | {"passed": check.passed} for check in checks],
            },
            indent=1,
        )
        + "\n",
        encoding="ascii",
    )
    partial.replace(path)
