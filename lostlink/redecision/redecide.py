"""The fates of all recorded transmissions, decided anew: by another radio, another seed, or the same, without flying.

    result = redecide("runs/20261121T120000Z-separation", radio="wifi-2.4", seed=7)
    result.table                # pyarrow: the rows of deliveries.parquet as that radio has them
    result.comparison.links     # per link: delivered before and after, by cause

What the nodes transmitted, where they were, and when their radios were off, stay as recorded: what another radio would
have let them hear changes no flight. Packets that never came to the radio (`transport`) stay lost; the longest that a
radio takes is its own.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bridge.bus.keys import MAIN
from bridge.radio.ledger_file import Books
from bridge.record.ending import was_cut
from bridge.record.inputs.radio_switches import switches_of
from bridge.record.provenance import version_noted
from bridge.record.tables.deliveries import (
    DELIVERIES,
    TOO_LONG,
    TRANSPORT,
    FatesInTable,
    Vocabulary,
    labels_of,
)
from bridge.record.tables.parquet import array_of
from bridge.record.tables.schema import Columns
from bridge.record.tables.truth import ATTITUDE, POSITION, TrueStates
from bridge.run.access import place_of
from bridge.scenario.file import with_changes
from bridge.scenario.model import Scenario
from bridge.scenario.resolve.channel import channels_of, medium_settings
from bridge.scenario.resolve.radio import radios_of
from channel.access.packets import PLAIN, Handling
from channel.medium.addressees import Addressees, codes_of
from channel.medium.ledger import Ledger
from channel.medium.reception import EVERYBODY, Packets
from channel.network.network import RadioRoute
from lostlink.reading.edited import edited_files, presets_of_today, radio_files
from lostlink.reading.moved import scenario_of
from lostlink.reading.rows import DeliveryRows
from lostlink.reading.sent import SentPackets
from lostlink.redecision.as_flown import refuse_another_flight
from lostlink.redecision.comparison import DecisionComparison, compare_decisions
from lostlink.redecision.on_network import NetworkAnew, Transmissions, decide_all
from lostlink.redecision.packet_facts import PacketFacts
from lostlink.redecision.settling import last_whole_ns, without_nonsense

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
        books: of ``after``, with the verdict of the channel's judge: of `main`, then of the other networks.
        routes: that changed, each with the name of its network, tick by tick.
        files: that its radios name, with their SHA-256.
        edited: what is another now than when the run was flown, or may be, as sentences: files, presets.
    """

    run: Path
    scenario: Scenario
    before: DeliveryRows
    after: DeliveryRows
    facts: PacketFacts
    books: tuple[Books, ...]
    routes: tuple[tuple[str, RadioRoute], ...] = ()
    files: Mapping[str, str] = field(default_factory=dict)
    edited: tuple[str, ...] = ()

    @property
    def ledger(self) -> Ledger:
        """The books of `main`."""
        return self.books[0].ledger

    @cached_property
    def comparison(self) -> DecisionComparison:
        """Before and after, side by side."""
        bins = {each.radio: each.ledger.bins() for each in self.books if not each.takes_time}
        networks = self.scenario.network_names
        before, after = (self.facts.with_radio(rows, networks) for rows in (self.before, self.after))
        return compare_decisions(before, after, bins)

    @property
    def disagrees(self) -> bool:
        """Whether what is decided is not what was recorded, as far as can be said.

        What a killed run lacks is not held against it; nor, where packets take time, that others had less to wait for.
        """
        if not was_cut(self.run):
            return not self.comparison.is_same
        takes_time = any(each.takes_time for each in self.books)
        return self.comparison.changed > 0 if takes_time else self.comparison.differs

    @property
    def is_routed(self) -> bool:
        """Whether nodes hand packets on."""
        return any(each.routing is not None for each in self.books)

    @property
    def is_parted(self) -> bool:
        """Whether there are partitions."""
        return bool(self.scenario.partitions)

    @property
    def table(self) -> pa.Table:
        """The rows of `deliveries.parquet` as this radio has them (docs/reference/run-output.md)."""
        import pyarrow as pa

        words = Vocabulary()
        fates = FatesInTable.of(routed=self.is_routed, parted=self.is_parted)
        columns = self.after.columns | self.facts.words(self.after.columns, words)
        columns |= {"fate": fates.places_of(columns["fate"])}
        names = labels_of(self.after.nodes) | {"fate": fates.names} | words.names
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
        run: directory of a run, finished or killed, or its name in `runs/`.
        radio: of the network `main`: a preset's name, a file or a mapping, as in a scenario; the run's own unless
            given. A node that has a radio of its own keeps it, and so do the other networks.
        seed: of all draws; the run's own unless given.
        on_progress: called now and then with the share that is done.

    Raises:
        ValueError: it is no run, its record is damaged or lacks what is needed, or there is no such radio.
        OSError: a file cannot be read.
    """
    asked: dict[str, Any] = {} if seed is None else {"seed": seed}
    asked |= {} if radio is None else {"radio": as_seen_from_here(radio)}
    directory = place_of(run) or Path(run)
    return decide(directory, with_changes(scenario_of(directory), asked), on_progress)


def as_seen_from_here(radio: str | dict[str, Any]) -> str | dict[str, Any]:
    """A radio's file with its whole path; a preset's name, or a mapping, as it is."""
    is_file = isinstance(radio, str) and Path(radio).suffix in (".yaml", ".yml")
    return str(Path(str(radio)).absolute()) if is_file else radio


def decide(run: Path, scenario: Scenario, on_progress: OnProgress = lambda _done: None) -> Redecision:
    """As `redecide`, by the radios and the seed of a scenario that has the run's nodes.

    Raises:
        ValueError, OSError: as `redecide`; or the scenario has another value of what stays as recorded.
    """
    nodes, period_ns = scenario.transceiver_ids, scenario.tick_period_ns
    recorded = scenario_of(run)
    refuse_another_flight(run, recorded, scenario)
    with version_noted(run):
        before = DeliveryRows.read(run, nodes)
        _refuse_repeated(run, before)
        positions = without_nonsense(TrueStates.read(run, scenario.stations, (*POSITION, *ATTITUDE)))
        if not positions.ticks_ns.size:
            raise ValueError(f"{run}: nothing to decide: no true position of any node was recorded")
        places = codes_of(nodes, scenario.groups)
        sent = []
        for node in nodes:
            sent.append(SentPackets(run, node, places))
            on_progress(0.0)
        facts = PacketFacts(run, before, sent, period_ns, took_no_time=_ideal_networks(recorded))
    packets, last_ns = _transmitted(sent, before), last_whole_ns(positions)
    if was_cut(run):
        packets = packets.at(packets.sim_time_ns <= last_ns)
    radios, handling, missed = facts.radios(packets), _handling(sent), _missed(before)
    if unknown := sorted(set(radios) - set(scenario.network_names)):
        raise ValueError(f"{run}: it has packets of radio {unknown[0]}, of which the scenario has no network")
    tell = _Progress(on_progress, packets.size)
    switches = {name: switches_of(scenario, run, name) for name in scenario.network_names}
    anew = []
    for channel in channels_of(scenario, switches):
        name = channel.name
        mine = _once(packets.at(np.flatnonzero(radios == name)), channel.medium.addressees, nodes)
        lost = missed if name == MAIN else {column: values[:0] for column, values in missed.items()}
        what = Transmissions(nodes, mine, handling, lost, positions, period_ns, facts)
        anew.append(NetworkAnew(channel, what))
    decide_all(anew, tell.done)
    after = _in_order(anew, before)
    routes = sorted((r for each in anew for r in each.routes), key=lambda r: r[1].arrived_ns // period_ns)
    books, files = tuple(each.books for each in anew), radio_files(scenario)
    edited = (*edited_files(run, files), *presets_of_today(run, recorded, scenario))
    return Redecision(run, scenario, before, after, facts, books, tuple(routes), files, edited)


def _refuse_repeated(run: Path, rows: DeliveryRows) -> None:
    """Of rows that name one packet and receiver none could be told from the others; by hand such a table is made."""
    keys = rows.each().keys()
    if len(np.unique(keys)) < len(keys):
        raise ValueError(f"{DELIVERIES.parquet_path(run)}: a packet has two rows for one receiver")


class _Progress:
    """Adds up what is done."""

    def __init__(self, on_progress: OnProgress, packets: int) -> None:
        self._on_progress, self._packets, self._done = on_progress, max(1, packets), 0

    def done(self, packets: int) -> None:
        self._done += packets
        self._on_progress(self._done / self._packets)


def _ideal_networks(scenario: Scenario) -> list[str]:
    """Those on which packets take no time."""
    media = {name: medium_settings(radios_of(scenario, (), name)) for name in scenario.network_names}
    return [name for name, settings in media.items() if not settings.takes_time]


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


def _once(packets: Packets, addressees: Addressees, nodes: Sequence[str]) -> Packets:
    """Each packet once: one for several that was too long for its radio has a row for each receiver.

    That is so of groups, and of all on networks that not all nodes are on. Whom it was for follows from who has a row;
    a receiver alone cannot be told from an addressee.
    """
    again = (packets.tx[1:] == packets.tx[:-1]) & (packets.seq[1:] == packets.seq[:-1])
    if not again.any():
        return packets
    to, [lasts] = packets.to.copy(), np.nonzero(np.append(~again, True))
    place = {node: index for index, node in enumerate(nodes)}
    members = [place[node] for node in addressees.nodes]
    for first, last in zip([0, *(lasts[:-1] + 1)], lasts, strict=True):
        if last > first:
            found = {members.index(rx) for rx in packets.to[first : last + 1].tolist()}
            to[last] = addressees.code_of(members.index(int(packets.tx[last])), found)
    return packets._replace(to=to).at(lasts)


def _in_order(anew: Sequence[NetworkAnew], before: DeliveryRows) -> DeliveryRows:
    """The rows of all networks, in the order of the record if that can be; they are taken from the networks.

    Column by column: all of them are much, and would be there three times.
    """
    counts = [sum(len(rows["tx"]) for rows in each.rows) for each in anew]
    parts = [rows for each in anew for rows in each.rows]
    columns = {name: np.concatenate([rows.pop(name) for rows in parts]) for name in before.columns}
    order = DeliveryRows(before.nodes, columns).order_of(before, np.repeat(np.arange(len(anew)), counts))
    return DeliveryRows(before.nodes, {name: columns.pop(name)[order] for name in before.columns})


def _missed(before: DeliveryRows) -> Columns:
    """What never came to the radio, as recorded."""
    return before.at(before.columns["fate"] == TRANSPORT).columns
