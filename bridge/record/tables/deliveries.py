"""The table `deliveries`: what became of packets, a row per packet and intended receiver. Written by the radio."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from enum import StrEnum
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bridge.bus.keys import ALL, MAIN
from bridge.bus.messages import Fates, Header
from bridge.record.packets import SentPacket
from bridge.record.tables.journal import LABELS_MAX, TableWriter
from bridge.record.tables.reader import no_rows, read_columns
from bridge.record.tables.schema import (
    COUNT,
    COUNT_MAX,
    LABEL,
    NUMBER,
    NUMBER_MAX,
    TICK,
    TIME_MAX_NS,
    Column,
    Columns,
    Table,
)
from channel.medium import reception
from channel.medium.reception import EVERYBODY, Receptions
from channel.network.instants import InstantColumns

SAID: Final = ("channel", "encoding")
"""Columns with what senders say of their packets."""
WORDS: Final = ("radio", *SAID)
"""Columns with names that are not known before they come: which radio it was, and `SAID`."""
INSTANTS: Final = ("entered_ns", "started_ns", "ended_ns", "arrived_ns")
"""When the packet entered its radio, when the transmission that decided began and ended at the sender, and when it was
there or lost for good; -1 where it did not."""
DELIVERIES: Final = Table(
    "deliveries",
    (
        Column("sim_time_ns", TICK, most=TIME_MAX_NS),
        Column("tx", LABEL),
        Column("rx", LABEL),
        Column("seq", TICK, most=NUMBER_MAX),
        Column("packets", COUNT, most=COUNT_MAX),
        Column("length_bytes", COUNT, most=COUNT_MAX),
        Column("distance_m", NUMBER, 1e3),
        Column("received_power_dbm", NUMBER, 1e3),
        Column("snr_db", NUMBER, 1e3),
        Column("per", NUMBER, 1e7),
        Column("fate", LABEL),
        *(Column(name, LABEL, comes_up=True) for name in WORDS),
        Column("received_ns", TICK),
        *(Column(name, TICK) for name in INSTANTS),
        Column("attempts", COUNT),
    ),
    keys=("sim_time_ns", "tx", "rx", "seq"),
    tick="sim_time_ns",
    node="tx",
)
FIGURES: Final = DELIVERIES.numbers
"""What the channel computed; nan where it computed nothing."""


class Cause(StrEnum):
    """Causes of loss that are not the channel's."""

    TRANSPORT = "transport"
    """The packet left its sender and never came to the router: the host lost it, not the radio."""
    TOO_LONG = "too_long"
    """The packet is longer than the MTU of the sender's radio."""


FATES: Final = (*(fate.value for fate in reception.FATES), *(cause.value for cause in Cause))
"""What became of a packet at one receiver; rows have places in this."""
DELIVERED, TRANSPORT, TOO_LONG = (
    FATES.index(name) for name in (reception.Fate.DELIVERED.value, Cause.TRANSPORT, Cause.TOO_LONG)
)
GAPS_FROM: Final = len(reception.FATES)
"""Fates from here on are not the channel's: such a row stands for packets that were lost before it."""
OF_ROUTING: Final = frozenset(fate.value for fate in (reception.Fate.NO_ROUTE, reception.Fate.HOP_LIMIT))
"""Fates that only tables of runs have whose nodes hand packets on: others are as they were without these."""

OF_PARTITIONS: Final = frozenset((reception.Fate.PARTITIONED.value,))
"""Likewise, of runs with partitions."""


class Gap(NamedTuple):
    """Packets of one sender that are lost before the channel: from ``first_seq`` on.

    Of those that never came to the radio nobody knows channel and encoding, and which radio they were for: they count
    as of `main`.
    """

    sim_time_ns: int
    tx: int
    to: int
    first_seq: int
    packets: int
    length_bytes: int
    cause: Cause
    channel: str = ""
    encoding: str = ""
    radio: str = MAIN


class Vocabulary:
    """Radios, channels and encodings, in the order in which rows first have them; `main` and "" come first.

    Attributes:
        names: by column.
    """

    def __init__(self) -> None:
        self.names: dict[str, list[str]] = {"radio": [MAIN], **{column: [""] for column in SAID}}
        self._places = {column: {names[0]: 0} for column, names in self.names.items()}

    def places(self, column: str, words: Sequence[str]) -> NDArray[np.int16]:
        """Where in `names` each word is; a new one that there is no room for is as the first."""
        names, known = self.names[column], self._places[column]
        for word in words:
            if word not in known and len(names) < LABELS_MAX:
                known[word] = len(names)
                names.append(word)
        return np.array([known.get(word, 0) for word in words], dtype=np.int16)

    def of(self, packets: Sequence[SentPacket | Gap], radio: str) -> Columns:
        """What is said of each of some packets of one radio network."""
        [place] = self.places("radio", [radio])
        said = {column: self.places(column, [getattr(p, column) for p in packets]) for column in SAID}
        return {"radio": np.full(len(packets), place, dtype=np.int16)} | said


class FatesInTable(NamedTuple):
    """Fates as a table has them.

    Attributes:
        names: in their order.
        places: of each of FATES in these.
    """

    names: tuple[str, ...]
    places: NDArray[np.int16]

    @classmethod
    def of(cls, *, routed: bool, parted: bool) -> FatesInTable:
        """Of a run whose nodes hand packets on, or not; with partitions or without."""
        absent = (frozenset() if routed else OF_ROUTING) | (frozenset() if parted else OF_PARTITIONS)
        names = tuple(name for name in FATES if name not in absent)
        places = [names.index(name) if name in names else -1 for name in FATES]
        return cls(names, np.array(places, dtype=np.int16))

    def places_of(self, fate: ArrayLike) -> NDArray[np.int16]:
        """Of places in FATES.

        Raises:
            ValueError: the table has no such fate.
        """
        found = np.asarray(self.places[np.asarray(fate)])
        if np.any(found < 0):
            raise ValueError("a fate that packets cannot have in this run")
        return found


class DeliveryWriter:
    """Writes what became of packets.

    Args:
        run: the run directory.
        nodes: ids of all nodes.
        words: that rows have places in.
        routed: whether nodes hand packets on.
        parted: whether there are partitions.
    """

    def __init__(
        self,
        run: Path,
        nodes: Sequence[str],
        words: Vocabulary | None = None,
        *,
        routed: bool = False,
        parted: bool = False,
    ) -> None:
        self.everybody = len(nodes)
        self._words = words or Vocabulary()
        self._fates = FatesInTable.of(routed=routed, parted=parted)
        labels = labels_of(nodes) | {"fate": self._fates.names} | self._words.names
        self._writer = TableWriter(run, DELIVERIES, labels)
        self.flush, self.close = self._writer.flush, self._writer.close

    def append(
        self,
        rows: int,
        *,
        packets: ArrayLike = 1,
        radio: ArrayLike = 0,
        channel: ArrayLike = 0,
        encoding: ArrayLike = 0,
        attempts: ArrayLike = 1,
        **columns: ArrayLike,
    ) -> None:
        """Append rows: arrays of that length, or one value for all of them.

        Args:
            rows: how many.
            packets: how many a row stands for: those that were lost together have one.
            radio: places in the words; of `main` unless given.
            channel: likewise, of "".
            encoding: likewise.
            attempts: how often it was on the air.
            columns: the other columns; the instants are ``sim_time_ns`` unless given. ``tx`` has places in ``nodes``,
                ``rx`` too or ``everybody``, ``fate`` places in FATES; ``length_bytes`` is as the error model counts it.

        Raises:
            ValueError: a column is missing or unknown, or an array has another length.
            TypeError: an array has numbers of another kind.
        """
        at_once = {name: columns["sim_time_ns"] for name in INSTANTS if "sim_time_ns" in columns}
        said = {"radio": radio, "channel": channel, "encoding": encoding}
        if "fate" in columns:
            columns["fate"] = self._fates.places_of(columns["fate"])
        self._writer.append(rows, **(at_once | {"packets": packets, "attempts": attempts} | said | columns))

    def write(self, columns: Columns, gaps: Iterable[Gap], received_ns: int) -> None:
        """Append a row for each reception, and one for packets that were lost together.

        Args:
            columns: as of `columns_of`.
            gaps: what was lost before the channel.
            received_ns: the tick at which they would have come.
        """
        self.append(len(columns["tx"]), **columns)
        for gap in gaps:
            self._write_gap(gap, received_ns)

    def _write_gap(self, gap: Gap, received_ns: int) -> None:
        self.append(
            1,
            sim_time_ns=gap.sim_time_ns,
            tx=gap.tx,
            rx=self.everybody if gap.to == EVERYBODY else gap.to,
            seq=gap.first_seq,
            packets=gap.packets,
            length_bytes=gap.length_bytes,
            fate=FATES.index(gap.cause),
            received_ns=received_ns,
            **self._words.of([gap], gap.radio),
            **dict.fromkeys(INSTANTS, -1),
            attempts=0,
            **dict.fromkeys(FIGURES, math.nan),
        )


def labels_of(nodes: Sequence[str]) -> dict[str, Sequence[str]]:
    """The names that rows have places in: those of all nodes, and of what becomes of packets."""
    return {"tx": tuple(nodes), "rx": (*nodes, ALL), "fate": FATES}


def columns_of(
    receptions: Receptions,
    counted_bytes: NDArray[np.int64],
    said: Columns,
    instants: InstantColumns | None = None,
) -> Columns:
    """A row per reception.

    Args:
        receptions: of some packets.
        counted_bytes: lengths of these packets as the error model counts them.
        said: of these packets: ``received_ns``, and what `Vocabulary` says.
        instants: of the receptions; all at once unless given.
    """
    r, p = receptions, receptions.packets
    instants = instants or InstantColumns.at_once(receptions)
    return {
        "sim_time_ns": p.sim_time_ns[r.packet],
        "tx": p.tx[r.packet],
        "rx": r.rx,
        "seq": p.seq[r.packet],
        "packets": np.ones(r.size, dtype=np.int32),
        "length_bytes": counted_bytes[r.packet].astype(np.int32),
        "distance_m": r.distance_m,
        "received_power_dbm": r.received_power_dbm,
        "snr_db": r.snr_db,
        "per": r.per,
        "fate": r.fate,
        **{name: values[r.packet] for name, values in said.items()},
        **{name: getattr(instants, name) for name in INSTANTS},
        "attempts": instants.attempts,
    }


def read_deliveries(run: Path, nodes: Sequence[str], names: Sequence[str] | None = None) -> Columns:
    """The columns of these names, or all: ``tx`` as places in ``nodes``, ``rx`` too or their number for everybody.

    Raises:
        TableError, OSError: the table is missing or damaged, or cannot be read.
    """
    return read_columns(run, DELIVERIES, names, labels_of(nodes))


def no_deliveries(names: Sequence[str] | None = None) -> Columns:
    """As `read_deliveries`, of a run that has none."""
    return no_rows(DELIVERIES, names, labels_of(()))


def for_each_receiver(columns: Columns, nodes: int) -> Columns:
    """The rows with one for each node but the sender in the place of one for everybody."""
    to_all = columns["rx"] == nodes
    if not to_all.any():
        return columns
    copies = np.where(to_all, nodes, 1)
    rows = np.repeat(np.arange(len(to_all)), copies)
    number = np.arange(len(rows)) - np.repeat(np.cumsum(copies) - copies, copies)
    rx = np.where(to_all[rows], number, columns["rx"][rows])
    kept = rx != columns["tx"][rows]
    return {name: values[rows[kept]] for name, values in columns.items()} | {"rx": rx[kept]}


def tick_of(sim_time_ns: NDArray[np.int64], tick_period_ns: int) -> NDArray[np.int64]:
    """The first tick at or after each instant."""
    return -(-sim_time_ns // tick_period_ns) * tick_period_ns


def fates_message(sim_time_ns: int, nodes: Sequence[str], columns: Columns, networks: Sequence[str]) -> Fates:
    """What the tick ``sim_time_ns`` settled, as a message.

    Args:
        sim_time_ns: the tick.
        nodes: in which ``tx`` and ``rx`` are places.
        columns: rows as of `read_deliveries`, none of them for everybody, ``radio`` as places in ``networks``.
        networks: names of radio networks.
    """
    c = columns
    return Fates(
        Header.at(sim_time_ns, ""),
        tuple(nodes),
        FATES,
        c["tx"].astype(np.uint16),
        c["rx"].astype(np.uint16),
        c["seq"],
        c["sim_time_ns"],
        c["length_bytes"].astype(np.uint32),
        c["distance_m"],
        c["received_power_dbm"],
        c["snr_db"],
        c["per"],
        c["fate"].astype(np.uint8).tobytes(),
        c["packets"].astype(np.uint32),
        delays_s(c),
        tuple(networks),
        c["radio"].astype(np.uint16),
        c["entered_ns"],
        c["started_ns"],
        c["ended_ns"],
        c["attempts"].astype(np.uint16),
    )


def delays_s(columns: Columns) -> NDArray[np.float64]:
    """From the sender's stamp to arrival; NaN of what was lost."""
    came = (columns["fate"] == DELIVERED) & (columns["arrived_ns"] >= 0)
    return np.where(came, (columns["arrived_ns"] - columns["sim_time_ns"]) / 1e9, np.nan)
