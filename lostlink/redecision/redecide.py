"""The fates of all recorded transmissions, decided anew: by another radio, another seed, or the same, without flying.

    result = redecide("runs/20261121T120000Z-separation", radio="wifi-2.4", seed=7)
    result.table                # pyarrow: the rows of deliveries.parquet as that radio has them
    result.comparison.links     # per link: delivered before and after, by cause

What the nodes transmitted, where they were, and when their radios were off, stay as recorded: what another radio would
have let them hear changes no flight. Packets that never came to the radio (`transport`) stay lost; the longest that a
radio takes is its own.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bridge.record.ending import was_cut
from bridge.record.radio_switches import switches_of
from bridge.record.tables.deliveries import (
    DELIVERIES,
    FATES,
    FIGURES,
    INSTANTS,
    TOO_LONG,
    TRANSPORT,
    Cause,
    Vocabulary,
    columns_of,
    labels_of,
    tick_of,
)
from bridge.record.tables.parquet import array_of
from bridge.record.tables.reader import joined
from bridge.record.tables.schema import Columns
from bridge.record.tables.truth import ATTITUDE, POSITION, TrueStates
from bridge.run.directory import RunDirectory
from bridge.scenario.file import with_changes
from bridge.scenario.model import Scenario
from bridge.scenario.resolve.channel import channel_of, medium_settings
from bridge.scenario.resolve.radio import radios_of
from bridge.scenario.resolve.sensing import emitters_of
from channel.access.packets import PLAIN, Handling
from channel.link.radio import Radio
from channel.medium.judge.check import Verdict
from channel.medium.judge.judge import Judge
from channel.medium.ledger import Ledger
from channel.medium.reception import EVERYBODY, Packets, Receptions
from channel.network.instants import NEVER_NS
from lostlink.reading.rows import DeliveryRows
from lostlink.reading.sent import SentPackets
from lostlink.redecision.comparison import DecisionComparison, compare_decisions
from lostlink.redecision.packet_facts import PacketFacts
from lostlink.redecision.settling import last_whole_ns, live, settle, without_nonsense

if TYPE_CHECKING:
    import pyarrow as pa

OnProgress = Callable[[float], object]


@dataclass(frozen=True)
class Redecision:
    """What a radio makes of recorded transmissions.

    Attributes:
        run: directory of the run.
        scenario: as decided: with the radio and the seed asked for.
        before: what was recorded.
        after: what is decided anew.
        facts: what is known of the packets.
        ledger: the books of ``after``.
        verdict: of the channel's judge, as in a run.
    """

    run: Path
    scenario: Scenario
    before: DeliveryRows
    after: DeliveryRows
    facts: PacketFacts
    ledger: Ledger
    verdict: Verdict

    @cached_property
    def comparison(self) -> DecisionComparison:
        """Before and after, side by side."""
        return compare_decisions(self.before, self.after, self.ledger.bins())

    @property
    def table(self) -> pa.Table:
        """The rows of `deliveries.parquet` as this radio has them (docs/reference/run-output.md)."""
        import pyarrow as pa

        words = Vocabulary()
        columns = self.after.columns | self.facts.words(self.after.columns, words)
        names = labels_of(self.after.nodes) | words.names
        return pa.table(
            {c.name: array_of(c, columns[c.name].astype(c.dtype), names) for c in DELIVERIES.columns}
        )


def redecide(
    run: Path | str,
    *,
    radio: str | dict[str, Any] | None = None,
    seed: int | None = None,
    on_progress: OnProgress = lambda _done: None,
) -> Redecision:
    """Decide every recorded transmission of a run anew, from the recorded positions.

    Args:
        run: directory of a run, finished or killed.
        radio: a preset's name, a file or a mapping, as in a scenario; the run's own unless given. A node that has a
            radio of its own keeps it.
        seed: of all draws; the run's own unless given.
        on_progress: called now and then with the share that is done.

    Raises:
        ValueError: it is no run, its record is damaged or lacks what is needed, or there is no such radio.
        OSError: a file cannot be read.
    """
    asked: dict[str, Any] = {} if seed is None else {"seed": seed}
    asked |= {} if radio is None else {"radio": as_seen_from_here(radio)}
    scenario = with_changes(RunDirectory(Path(run)).scenario, asked)
    return decide(Path(run), scenario, on_progress)


def as_seen_from_here(radio: str | dict[str, Any]) -> str | dict[str, Any]:
    """A radio's file with its whole path; a preset's name, or a mapping, as it is."""
    is_file = isinstance(radio, str) and Path(radio).suffix in (".yaml", ".yml")
    return str(Path(str(radio)).absolute()) if is_file else radio


def decide(run: Path, scenario: Scenario, on_progress: OnProgress = lambda _done: None) -> Redecision:
    """As `redecide`, by the radios and the seed of a scenario that has the run's nodes.

    Raises:
        ValueError, OSError: as `redecide`.
    """
    nodes, period_ns = scenario.transceiver_ids, scenario.tick_period_ns
    emitters = emitters_of(scenario)
    radios = radios_of(scenario, emitters)
    before = DeliveryRows.read(run, nodes)
    positions = without_nonsense(TrueStates.read(run, scenario.stations, (*POSITION, *ATTITUDE)))
    if not positions.ticks_ns.size:
        raise ValueError(f"{run}: nothing to decide: no true position of any node was recorded")
    places = {node: place for place, node in enumerate(nodes)}
    sent = [SentPackets(run, node, places) for node in nodes]
    was_ideal = not medium_settings(radios_of(RunDirectory(run).scenario)).takes_time
    facts = PacketFacts(run, before, sent, period_ns, took_no_time=was_ideal)
    packets = _transmitted(sent, before)
    if was_cut(run):
        packets = packets.at(packets.sim_time_ns <= last_whole_ns(positions))
    packets, too_long = _split(packets, [radios[node] for node in nodes])
    judge = Judge(len(nodes), scenario.seed)
    channel = channel_of(scenario, radios, judge, switches_of(scenario, run))
    ledger = Ledger(nodes, causes=tuple(Cause))
    ledger.send(packets)
    done, parts = 0, [_too_long_rows(too_long, len(nodes), facts), _missed(before)]
    for part in parts:
        _book(ledger, part)
    medium, due_ns = channel.medium, tick_of(packets.sim_time_ns, period_ns)
    if channel.network is None:
        for receptions in settle(medium, positions, packets, due_ns):
            ledger.settle(receptions)
            settled = receptions.packets
            came = {"received_ns": facts.received_ns(settled.seq, settled.tx)}
            parts.append(columns_of(receptions, medium.counted_bytes(settled), came))
            done += receptions.packets.size
            on_progress(done / max(1, packets.size))
    else:
        handling = _handling(sent)
        for tick_ns, lived in live(channel.network, medium, positions, packets, due_ns, handling, period_ns):
            ledger.book(lived.receptions)
            if lived.first:
                ledger.place(Receptions.joined(lived.first))
            settled = lived.receptions.packets
            came = {"received_ns": np.full(settled.size, tick_ns)}
            parts.append(columns_of(lived.receptions, medium.counted_bytes(settled), came, lived.instants))
            done += len(lived.done)
            on_progress(done / max(1, packets.size))
    ledger.check(in_flight=0)
    after = DeliveryRows(nodes, joined(parts)).in_order_of(before)
    return Redecision(run, scenario, before, after, facts, ledger, judge.verdict())


def _transmitted(nodes: Sequence[SentPackets], before: DeliveryRows) -> Packets:
    """All that the nodes transmitted and the router got, in the order in which a radio settles it.

    What was longer than the run's own radio takes is not in the streams; its row says how long it was.
    """
    parts = [
        Packets(sent.sim_time_ns, np.full(len(sent), tx), sent.seq, sent.length_bytes, sent.to)
        for tx, sent in enumerate(nodes)
    ]
    rows = before.at(before.columns["fate"] == TOO_LONG).columns
    to = np.where(rows["rx"] == len(before.nodes), EVERYBODY, rows["rx"])
    parts.append(
        Packets(rows["sim_time_ns"], rows["tx"], rows["seq"], rows["length_bytes"].astype(np.int64), to)
    )
    return Packets.joined(parts).in_order()


def _handling(nodes: Sequence[SentPackets]) -> dict[tuple[int, int], Handling]:
    """What radios were asked to do with packets, by sender and number; the others are plain."""
    return {
        (tx, int(seq)): handling
        for tx, sent in enumerate(nodes)
        for seq, handling in zip(sent.seq, sent.handling, strict=True)
        if handling != PLAIN
    }


def _split(packets: Packets, radios: list[Radio]) -> tuple[Packets, Packets]:
    """Packets that their senders' radios take, and those that are too long for them."""
    mtu_bytes = np.array([radio.config.mtu_bytes for radio in radios])
    fits = packets.length_bytes <= mtu_bytes[packets.tx]
    return packets.at(fits), packets.at(~fits)


def _too_long_rows(packets: Packets, everybody: int, facts: PacketFacts) -> Columns:
    return {
        "sim_time_ns": packets.sim_time_ns,
        "tx": packets.tx,
        "rx": np.where(packets.to == EVERYBODY, everybody, packets.to),
        "seq": packets.seq,
        "packets": np.ones(packets.size, dtype=np.int32),
        "length_bytes": packets.length_bytes.astype(np.int32),
        **dict.fromkeys(FIGURES, np.full(packets.size, math.nan)),
        "fate": np.full(packets.size, TOO_LONG),
        "received_ns": facts.received_ns(packets.seq, packets.tx),
        **dict.fromkeys(INSTANTS, np.full(packets.size, NEVER_NS)),
        "attempts": np.zeros(packets.size, dtype=np.int32),
    }


def _missed(before: DeliveryRows) -> Columns:
    """What never came to the radio, as recorded."""
    return before.at(before.columns["fate"] == TRANSPORT).columns


def _book(ledger: Ledger, rows: Columns) -> None:
    """Book out, and lost at once, what no channel had to do with."""
    names = (*ledger.nodes, None)
    for tx, rx, fate, count in zip(*(rows[n].tolist() for n in ("tx", "rx", "fate", "packets")), strict=True):
        ledger.lose(ledger.nodes[tx], FATES[fate], count, names[rx])
