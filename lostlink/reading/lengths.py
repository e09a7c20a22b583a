"""How long the packets of a run are: the model's curve over distance is that of their median length."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from bridge.record.tables.schema import TableError
from bridge.scenario.model import Scenario
from bridge.scenario.nodes import MAIN
from lostlink.reading.rows import Deliveries, RecordedDeliveries

if TYPE_CHECKING:
    from channel.link.radio import Radio


def median_payload_bytes(radio: Radio, packets: Mapping[int, int]) -> int | None:
    """The median payload of packets, counted by the length that the error model has; None if there are none."""
    lengths = np.array(sorted(packets), dtype=np.int64)
    if not lengths.size:
        return None
    until = np.cumsum([packets[length] for length in lengths.tolist()])
    median_bytes = int(lengths[np.searchsorted(2 * until, until[-1])])
    return max(0, median_bytes - radio.length_bytes(0))


def packets_by_length(deliveries: Deliveries) -> dict[int, int]:
    """How many packets of each length there are on `main`."""
    found: Counter[int] = Counter()
    for rows in deliveries.parts("length_bytes", "radio"):
        mine = rows.columns["radio"] == MAIN
        lengths, place = np.unique(rows.columns["length_bytes"][mine], return_inverse=True)
        counts = np.bincount(place, rows.columns["packets"][mine], len(lengths)).astype(np.int64)
        found.update(dict(zip(lengths.tolist(), counts.tolist(), strict=True)))
    return found


def recorded_payload_bytes(run: Path, scenario: Scenario, radio: Radio) -> int | None:
    """The median payload of a run's packets; None if none is recorded, or the table cannot be read."""
    try:
        packets = packets_by_length(RecordedDeliveries(run, scenario.transceiver_ids, may_lack=True))
    except (OSError, TableError):
        return None
    return median_payload_bytes(radio, packets)
