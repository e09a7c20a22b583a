"""What a run wrote down, as it is played: ticks, and the tables and streams of what happened at them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.radio.picture import LINK_PERIOD_NS
from bridge.record.events import RunEvent, read_reports
from bridge.record.inputs.radio_switches import switches_of
from bridge.record.provenance import version_noted
from bridge.record.tables.deliveries import DELIVERIES, SAID, labels_of
from bridge.record.tables.reader import joined, no_rows, read_batches
from bridge.record.tables.schema import Columns
from bridge.record.tables.states import States
from bridge.record.tables.truth import TRUTH, TrueStates
from channel.medium.addressees import codes_of
from lostlink.reading.moved import scenario_of
from lostlink.reading.rows import RUN_ENDED, DeliveryRows
from lostlink.reading.sent import SentPackets
from lostlink.replay.logged import NodeLogged
from lostlink.replay.measured import ReportedMeasurements

COLUMNS = tuple(column.name for column in DELIVERIES.columns if column.name not in SAID)


class TickedRecord:
    """The record of one run.

    Args:
        run: its directory, finished or killed.

    Attributes:
        scenario: as flown.
        nodes: ids of the nodes that exchange packets.
        ticks_ns: all ticks, rising.
        decisions: what became of packets.
        rows_until: how many of its rows were settled by each tick: what was written after the last is of none.
        radios: when each node's radio was off.

    Raises:
        ValueError: it is no run, or nothing of it was recorded.
        OSError: it cannot be read.
    """

    def __init__(self, run: Path) -> None:
        self.run = run
        with version_noted(run):
            self.scenario = scenario_of(run)
            self.nodes = self.scenario.transceiver_ids
            if not TRUTH.is_in(run):
                raise ValueError(
                    f"{run}: nothing to play: it has no {TRUTH.parquet_path(run).name}, nor a journal of it"
                )
            self.truth = TrueStates.read(run, self.scenario.stations)
            self.ticks_ns = self.truth.ticks_ns
            if not self.ticks_ns.size:
                raise ValueError(
                    f"{run}: nothing to play: the run ended before its first tick was written down"
                )
            self.networks = self.scenario.network_names
            self.decisions = Decisions(run, self.nodes, self.networks)
            self.rows_until = self._rows_until()
            self.radios = switches_of(self.scenario, run)

    def _rows_until(self) -> NDArray[np.intp]:
        until, last_ns = np.zeros(self.ticks_ns.size, np.intp), self.ticks_ns + self.scenario.tick_period_ns
        is_cut = False
        for part in self.decisions.parts():  # all columns: what is damaged is told before it is played
            cut = np.flatnonzero(part["fate"] == RUN_ENDED)
            settled_ns = part["received_ns"][: cut[0]] if cut.size else part["received_ns"]
            if not is_cut:
                until += np.searchsorted(settled_ns, last_ns, side="right")
            is_cut |= cut.size > 0
        return until

    @cached_property
    def links_due(self) -> NDArray[np.bool_]:
        """Ticks at which a run publishes link reports."""
        due, reported_ns = np.zeros(self.ticks_ns.size, dtype=bool), -LINK_PERIOD_NS
        for tick, sim_time_ns in enumerate(self.ticks_ns.tolist()):
            if sim_time_ns - reported_ns >= LINK_PERIOD_NS:
                due[tick], reported_ns = True, sim_time_ns
        due[-1] = True
        return due

    # What is read when it is asked for.

    @cached_property
    def sent(self) -> list[SentPackets]:
        """What each node transmitted."""
        places = codes_of(self.nodes, self.scenario.groups)
        return [SentPackets(self.run, node, places) for node in self.nodes]

    @cached_property
    def states(self) -> States:
        """The states of each node."""
        return States.read(self.run, self.nodes)

    @cached_property
    def measured(self) -> ReportedMeasurements:
        """What sensors reported."""
        return ReportedMeasurements(self.run, self.scenario, self.nodes)

    @cached_property
    def logged(self) -> dict[str, NodeLogged]:
        """What the agent of each node logged."""
        return {node: NodeLogged(self.run, node) for node in self.nodes}

    @cached_property
    def events(self) -> tuple[RunEvent, ...]:
        """What the processes of the run reported, by sim time."""
        return read_reports(self.run).events


class Decisions:
    """The deliveries of a run, read as they are played, since those of many UA are larger than memory.

    Args:
        run: its directory.
        nodes: ids of all its nodes.
        networks: in which ``radio`` of rows is a place.
    """

    def __init__(self, run: Path, nodes: Sequence[str], networks: Sequence[str]) -> None:
        self._run, self._nodes = run, tuple(nodes)
        self._names = labels_of(nodes) | {"radio": networks}
        self._rewind()

    def _rewind(self) -> None:
        self._begin, self._ahead = 0, no_rows(DELIVERIES, COLUMNS, self._names)
        self._parts = self.parts()

    def parts(self) -> Iterator[Columns]:
        """All rows, some at a time."""
        is_there = DELIVERIES.is_in(self._run)
        return read_batches(self._run, DELIVERIES, COLUMNS, self._names) if is_there else iter(())

    def at(self, begin: int, end: int) -> DeliveryRows:
        """Some of the rows; quickest if they follow those of the call before."""
        if begin < self._begin:
            self._rewind()
        while self._begin + len(self._ahead["tx"]) < end:
            passed = min(begin - self._begin, len(self._ahead["tx"]))
            self._begin += passed
            left = {name: values[passed:] for name, values in self._ahead.items()}
            self._ahead = joined((left, next(self._parts)))
        rows = slice(begin - self._begin, end - self._begin)
        return DeliveryRows(self._nodes, {name: values[rows] for name, values in self._ahead.items()})
