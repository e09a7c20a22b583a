"""What a record says of the packets that nodes transmitted, beside what a channel computes of them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.bus.keys import MAIN
from bridge.record.tables.deliveries import TOO_LONG, WORDS, Vocabulary, read_deliveries, tick_of
from bridge.record.tables.schema import Columns
from channel.medium.reception import Packets
from lostlink.reading.rows import DeliveryRows
from lostlink.reading.sent import SentPackets


class PacketFacts:
    """Radio, channel, encoding and tick of reception of packets, by sender and number.

    Args:
        run: directory of the run.
        before: what was recorded.
        sent: what each node transmitted.
        tick_period_ns: of the run.
        took_no_time: names of the networks on which the tick of reception is that of the packet; on others receptions
            have one each.

    Raises:
        TableError, OSError: the deliveries cannot be read.
    """

    def __init__(
        self,
        run: Path,
        before: DeliveryRows,
        sent: Sequence[SentPackets],
        tick_period_ns: int,
        *,
        took_no_time: Sequence[str] = (MAIN,),
    ) -> None:
        self._nodes = len(sent)
        rows = before.columns
        settled, [long] = self._keys(rows["seq"], rows["tx"]), np.nonzero(rows["fate"] == TOO_LONG)
        keys = [self._keys(each.seq, tx) for tx, each in enumerate(sent)]
        words: Columns = {
            "radio": np.array([word for each in sent for word in each.radios], dtype=object),
            "channel": np.array([word for each in sent for word in each.channels], dtype=object),
            "encoding": np.array([word for each in sent for word in each.encodings], dtype=object),
        }
        due_ns = [tick_of(each.sim_time_ns, tick_period_ns) + tick_period_ns for each in sent]
        if long.size:  # these are not in the streams
            told = read_deliveries(run, before.nodes, WORDS)
            words = {name: np.concatenate([words[name], told[name][long]]) for name in WORDS}
        self._known, first = np.unique(np.concatenate([*keys, settled[long]]), return_index=True)
        self._words = {name: values[first] for name, values in words.items()}
        self._received_ns = np.concatenate([*due_ns, rows["received_ns"][long]])[first]
        if not len(self._known):
            return
        places, known = self._places(settled)
        known &= np.isin(self._words["radio"].astype(str), took_no_time)[places]
        self._received_ns[places[known]] = rows["received_ns"][known]

    def _keys(self, seq: NDArray[np.int64], tx: NDArray[np.intp] | int) -> NDArray[np.int64]:
        keys: NDArray[np.int64] = seq * self._nodes + tx
        return keys

    def _places(self, keys: NDArray[np.int64]) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
        """Where each packet is, and whether it is there."""
        places = np.minimum(np.searchsorted(self._known, keys), max(0, len(self._known) - 1))
        return places, np.equal(self._known[places], keys) if len(self._known) else np.zeros(len(keys), bool)

    def received_ns(self, seq: NDArray[np.int64], tx: NDArray[np.intp]) -> NDArray[np.int64]:
        """The ticks at which receivers have packets that are there, or would have them."""
        return self._received_ns[self._places(self._keys(seq, tx))[0]]

    def radios(self, packets: Packets) -> NDArray[np.object_]:
        """Names of the radios of packets that came to the radio."""
        if not packets.size:
            return np.zeros(0, dtype=object)
        return self._words["radio"][self._places(self._keys(packets.seq, packets.tx))[0]]

    def with_radio(self, rows: DeliveryRows, networks: tuple[str, ...]) -> DeliveryRows:
        """Rows with the name of each one's radio network: `main` of packets that never came to the radio."""
        c = rows.columns
        places, known = self._places(self._keys(c["seq"], c["tx"]))
        names = np.full(len(rows), MAIN, dtype=object)
        names[known] = self._words["radio"][places[known]]
        return DeliveryRows(rows.nodes, c | {"radio": names}, networks)

    def words(self, rows: Columns, words: Vocabulary) -> Columns:
        """Radio, channel and encoding of rows, as places among ``words``; the first of packets that never came."""
        places, known = self._places(self._keys(rows["seq"], rows["tx"]))
        found = {}
        for name, values in self._words.items():
            texts = np.full(len(places), words.names[name][0], dtype=object)
            texts[known] = values[places[known]]
            found[name] = words.places(name, texts.tolist())
        return found
