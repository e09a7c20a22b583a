"""Run directories made by the writers that a run has."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from aps.wire.dialect import Encoder, mavlink
from bridge.bus.messages import Header, Truth, Vector3
from bridge.record.names import Stream, from_autopilot, packets, to_autopilot
from bridge.record.pack import pack_streams
from bridge.record.packets import SentPacket, encode_packet
from bridge.record.streams import Entry, StreamWriter
from bridge.record.tables.deliveries import DeliveryWriter, Vocabulary
from bridge.record.tables.every import finish_tables
from bridge.record.tables.schema import Table
from bridge.record.tables.truth import TRUTH, TruthWriter
from tests.unit.bridge.record.tables.rows import DeliveryRow, append_rows

TICK_NS = 50_000_000
NODES = ("0", "1")


def truth_at(node: str, tick_ns: int) -> Truth:
    north_m = tick_ns / 1e9 + float(node)
    return Truth(Header.at(tick_ns, node), 8.5, 47.4, 420.0, Vector3(north_m, 0.0, -10.0))


def heartbeat(encoder: Encoder, custom_mode: int = 4) -> bytes:
    return encoder.encode(mavlink.MAVLink_heartbeat_message(2, 3, 81, custom_mode, 4, 3))


def row_at(tick_ns: int, tx: str, rx: str) -> DeliveryRow:
    figures = (100.0, -70.0, 20.0, 0.01)
    came_ns = tick_ns + TICK_NS
    return DeliveryRow(tick_ns, tx, rx, tick_ns // TICK_NS, 40, *figures, "delivered", received_ns=came_ns)


@dataclass
class RunContent:
    """What a run directory is to hold; tests change it before it is written."""

    streams: dict[Stream, list[Entry]] = field(default_factory=dict)
    truths: list[Truth] = field(default_factory=list)
    rows: list[DeliveryRow] = field(default_factory=list)

    def change(self, stream: Stream, index: int, payload: bytes) -> None:
        self.streams[stream][index] = self.streams[stream][index]._replace(payload=payload)

    def change_row(self, index: int, **values: object) -> None:
        self.rows[index] = replace(self.rows[index], **values)  # type: ignore[arg-type]

    def change_truth(self, index: int, **values: object) -> None:
        self.truths[index] = replace(self.truths[index], **values)  # type: ignore[arg-type]

    def write(self, path: Path, *, is_finished: bool = True) -> Path:
        path.mkdir(parents=True)
        for stream, entries in self.streams.items():
            with StreamWriter(stream.path(path)) as writer:
                for entry in entries:
                    writer.write(*entry)
        truth = TruthWriter(path, NODES)
        for state in self.truths:
            truth.append(state.header.stamp.ns, [state])
        truth.close()
        deliveries = DeliveryWriter(path, NODES, words := Vocabulary())
        append_rows(deliveries, NODES, self.rows, words)
        deliveries.close()
        if is_finished:
            finish_tables(path)
            pack_streams(path)
        return path


Change = Callable[[RunContent], object]


def content(ticks: int = 20) -> RunContent:
    made = RunContent()
    for node in NODES:
        autopilot, daemon = Encoder(int(node) + 1, 1), Encoder(int(node) + 1, 191)
        times = [i * TICK_NS for i in range(ticks)]
        made.streams[from_autopilot(node)] = [Entry(t, heartbeat(autopilot)) for t in times]
        made.streams[to_autopilot(node)] = [Entry(t, heartbeat(daemon)) for t in times[::5]]
        made.streams[packets(node)] = [
            Entry(t, encode_packet(SentPacket(i, t, "team", b"payload"))) for i, t in enumerate(times)
        ]
    made.truths = [truth_at(node, i * TICK_NS) for i in range(ticks) for node in NODES]
    made.rows = [row_at(i * TICK_NS, tx, rx) for i in range(ticks) for tx, rx in (("0", "1"), ("1", "0"))]
    return made


def make_run(
    path: Path, change: Change = lambda _: None, ticks: int = 20, *, is_finished: bool = True
) -> Path:
    """Write a run directory; ``change`` alters its content first. Not finished: as its processes leave it if killed."""
    made = content(ticks)
    change(made)
    return made.write(path, is_finished=is_finished)


def change_table(run: Path, index: int, table: Table = TRUTH, **values: Any) -> None:
    """Alter a row of a table of a finished run."""
    path = table.parquet_path(run)
    old = pq.read_table(path)
    rows = old.to_pylist()
    rows[index] |= values
    pq.write_table(pa.Table.from_pylist(rows, schema=old.schema), path)
