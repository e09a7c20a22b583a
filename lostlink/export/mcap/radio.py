"""From the table of deliveries: fates tick by tick, the links, and who was heard; and the packets transmitted."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from bridge.bus.messages import CommunicationMatrix, Fates, Header, Links, Packet, encode
from bridge.record import names
from bridge.record.inputs.radio_switches import switches_of
from bridge.record.packets import packets_of
from bridge.record.streams import stream_exists
from bridge.record.tables.deliveries import (
    DELIVERIES,
    FIGURES,
    fates_message,
    for_each_receiver,
    labels_of,
)
from bridge.record.tables.schema import Columns
from bridge.scenario.model import Scenario
from lostlink.export.mcap.file import McapFile
from lostlink.export.mcap.rounding import rounded
from lostlink.export.mcap.source import FOREVER_NS, Feed, Item, Slices
from lostlink.reading.links.known import KnownLinks


class RadioSource:
    """Fates, links and the communication matrix, a message each per tick; the last links are there at any rate.

    Args:
        run: the run directory.
        file: where to.
        scenario: of the run.
    """

    def __init__(self, run: Path, file: McapFile, scenario: Scenario) -> None:
        self._nodes, self._tick_ns = scenario.transceiver_ids, scenario.tick_period_ns
        self._networks = scenario.network_names
        self._links = KnownLinks(self._nodes, self._networks, switches_of(scenario, run))
        labels = labels_of(self._nodes) | {"radio": self._networks}
        self._slices = Slices(run, DELIVERIES, labels, by="received_ns")
        self._held_ns: int | None = None  # the newest tick, if its links were not due
        settings = file.settings
        self._channels = {
            kind: file.channel(f"/{kind}", cls.TYPE, kind) if settings.has(kind) else None
            for kind, cls in (("fates", Fates), ("links", Links), ("communication", CommunicationMatrix))
        }

    def until(self, time_ns: int) -> Iterator[Item]:
        """The messages of whole ticks up to ``time_ns``."""
        columns = self._slices.until(time_ns + self._tick_ns)
        if columns is not None:
            yield from self._ticks(self._in_ticks(columns))
        links = self._channels["links"]
        if time_ns == FOREVER_NS and self._held_ns is not None and links is not None:
            yield self._held_ns, links, encode(self._links.report(self._held_ns))

    def _ticks(self, columns: Columns) -> Iterator[Item]:
        ends = np.flatnonzero(np.diff(columns["tick_ns"])) + 1
        for begin, end in zip([0, *ends.tolist()], [*ends.tolist(), len(columns["tick_ns"])], strict=True):
            tick = {name: values[begin:end] for name, values in columns.items()}
            yield from self._tick(int(tick["tick_ns"][0]), tick)

    def _in_ticks(self, columns: Columns) -> Columns:
        """With a tick for each row, and rows for everybody once for each receiver."""
        # What was under way when a run ended in its first tick has no tick before.
        ticks_ns = np.maximum(columns["received_ns"] - self._tick_ns, 0)
        figures = {name: rounded(name, columns[name]) for name in FIGURES}
        return for_each_receiver(columns | figures | {"tick_ns": ticks_ns}, len(self._nodes))

    def _tick(self, tick_ns: int, rows: Columns) -> Iterator[Item]:
        self._links.take(rows)
        for kind, channel in self._channels.items():
            is_due = channel is not None and channel.is_due(tick_ns)
            if kind == "links":
                self._held_ns = None if is_due else tick_ns
            if channel is None or not is_due:
                continue
            if kind == "fates":
                message: Any = fates_message(tick_ns, self._nodes, rows, self._networks)
            elif kind == "links":
                message = self._links.report(tick_ns)
            else:
                message = self._links.picture.matrix(tick_ns)
            yield tick_ns, channel, encode(message)


def packets_source(run: Path, file: McapFile, node: str, prefix: str) -> Feed | None:
    """What a node transmitted; None if that is not wanted, or there is no stream of it."""
    if not file.settings.has("packets") or not stream_exists(names.packets(node).path(run)):
        return None
    channel = file.channel(f"/{prefix}/packets", Packet.TYPE, "packets")

    def items() -> Iterator[Item]:
        for tick_ns, packet in packets_of(run, node):
            payload = packet.payload if file.settings.payloads else b""
            header = Header.at(packet.sim_time_ns, node)
            message = Packet(
                header, packet.seq, packet.address, packet.encoding, len(packet.payload), payload
            )
            yield tick_ns, channel, encode(message)

    return Feed(items())
