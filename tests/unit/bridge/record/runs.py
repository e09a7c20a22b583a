"""Run directories made by the writers that a run has."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

from aps.wire.dialect import Encoder, mavlink
from bridge.bus.messages import Header, Truth, Vector3, encode
from bridge.radio.deliveries import DELIVERIES, DeliveriesWriter, DeliveryRow
from bridge.record.names import Stream, from_autopilot, packets, to_autopilot, truth
from bridge.record.packets import SentPacket, encode_packet
from bridge.record.streams import Entry, StreamWriter

TICK_NS = 50_000_000
NODES = ("0", "1")


def truth_at(node: str, tick_ns: int) -> Truth:
    north_m = tick_ns / 1e9 + float(node)
    return Truth(Header.at(tick_ns, node), 8.5, 47.4, 420.0, Vector3(north_m, 0.0, -10.0))


def heartbeat(encoder: Encoder, custom_mode: int = 4) -> bytes:
    return encoder.encode(mavlink.MAVLink_heartbeat_message(2, 3, 81, custom_mode, 4, 3))


def row_at(tick_ns: int, tx: str, rx: str) -> DeliveryRow:
    return DeliveryRow(tick_ns, tx, rx, tick_ns // TICK_NS, 40, 100.0, -70.0, 20.0, 0.01, "delivered")


@dataclass
class RunContent:
    """What a run directory is to hold; tests change it before it is written."""

    streams: dict[Stream, list[Entry]] = field(default_factory=dict)
    rows: list[DeliveryRow] = field(default_factory=list)

    def change(self, stream: Stream, index: int, payload: bytes) -> None:
        self.streams[stream][index] = self.streams[stream][index]._replace(payload=payload)

    def change_row(self, index: int, **values: object) -> None:
        self.rows[index] = replace(self.rows[index], **values)  # type: ignore[arg-type]

    def write(self, path: Path) -> Path:
        for stream, entries in self.streams.items():
            with StreamWriter(stream.path(path)) as writer:
                for entry in entries:
                    writer.write(*entry)
        record = DeliveriesWriter(path / DELIVERIES)
        record.write(self.rows)
        record.close()
        return path


Change = Callable[[RunContent], object]


def content(ticks: int = 20) -> RunContent:
    made = RunContent()
    for node in NODES:
        autopilot, daemon = Encoder(int(node) + 1, 1), Encoder(int(node) + 1, 191)
        times = [i * TICK_NS for i in range(ticks)]
        made.streams[truth(node)] = [Entry(t, encode(truth_at(node, t))) for t in times]
        made.streams[from_autopilot(node)] = [Entry(t, heartbeat(autopilot)) for t in times]
        made.streams[to_autopilot(node)] = [Entry(t, heartbeat(daemon)) for t in times[::5]]
        made.streams[packets(node)] = [
            Entry(t, encode_packet(SentPacket(i, t, "team", b"payload"))) for i, t in enumerate(times)
        ]
    made.rows = [row_at(i * TICK_NS, tx, rx) for i in range(ticks) for tx, rx in (("0", "1"), ("1", "0"))]
    return made


def make_run(path: Path, change: Change = lambda _: None, ticks: int = 20) -> Path:
    """Write a run directory; ``change`` alters its content first."""
    made = content(ticks)
    change(made)
    return made.write(path)
