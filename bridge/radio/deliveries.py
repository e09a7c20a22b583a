"""The record of a run: `deliveries.csv`, a row per packet and intended receiver, and the books in `ledger.json`."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import TextIO, TypeVar

from bridge.record.names import RECORD_FILE
from channel.medium.ledger import Ledger

DELIVERIES = RECORD_FILE
LEDGER = "ledger.json"
COLUMNS = (
    "sim_time_ns",
    "tx",
    "rx",
    "seq",
    "length_bytes",
    "distance_m",
    "received_power_dbm",
    "snr_db",
    "per",
    "fate",
)


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


class DeliveriesWriter:
    """Writes rows as they are settled; what was written is on disk after `flush`."""

    def __init__(self, path: Path) -> None:
        self._file: TextIO = path.open("w", newline="", encoding="ascii")
        self._file.write(",".join(COLUMNS) + "\n")

    def write(self, rows: Iterable[DeliveryRow]) -> None:
        """Append rows: powers to 0.001 dB, distances to 1 mm, PER to seven digits."""
        for r in rows:
            self._file.write(
                f"{r.sim_time_ns},{r.tx},{r.rx},{r.seq},{r.length_bytes},{r.distance_m:.3f},"
                f"{r.received_power_dbm:.3f},{r.snr_db:.3f},{r.per:.7g},{r.fate}\n"
            )

    def flush(self) -> None:
        """Hand everything to the operating system."""
        self._file.flush()

    def close(self) -> None:
        """Flush and close."""
        self._file.close()


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


def read_deliveries(path: Path) -> Iterator[DeliveryRow]:
    """The rows of a `deliveries.csv`.

    Raises:
        ValueError: if the columns are not ours or a row is broken, with its line.
    """
    with path.open(newline="", encoding="ascii") as file:
        reader = csv.reader(file)
        if tuple(next(reader, ())) != COLUMNS:
            raise ValueError(f"{path}:1: columns have to be {','.join(COLUMNS)}")
        for row in reader:
            try:
                yield _delivery(row)
            except (ValueError, IndexError) as error:
                raise ValueError(f"{path}:{reader.line_num}: not a delivery: {error}") from error


def _delivery(row: list[str]) -> DeliveryRow:
    distance_m, received_power_dbm, snr_db, per = (float(value) for value in row[5:9])
    sent = (int(row[0]), row[1], row[2], int(row[3]), int(row[4]))
    return DeliveryRow(*sent, distance_m, received_power_dbm, snr_db, per, row[9])
