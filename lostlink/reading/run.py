"""`load_run`: a run's directory as one object, whether the run came to its end, was killed or still goes on."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from bridge.bus.messages import AgentStatus
from bridge.record import names
from bridge.record.events import Reports, read_reports
from bridge.record.inputs.fields import to_fields
from bridge.record.inputs.file import RecordedInput, all_inputs
from bridge.record.logged import LoggedValue, logged_of
from bridge.record.packets import SentPacket, packets_of
from bridge.record.provenance import Provenance, read_provenance, version_noted
from bridge.record.streams import Entry, entries_of
from bridge.record.tables.deliveries import DELIVERIES
from bridge.record.tables.every import TABLES
from bridge.record.tables.logged import LOGGED_FILE, read_logged
from bridge.record.tables.measurements import MEASUREMENTS
from bridge.record.tables.reader import read_arrow, read_columns
from bridge.record.tables.routes import ROUTES
from bridge.record.tables.schema import Table
from bridge.record.tables.states import STATES
from bridge.record.tables.truth import TRUTH
from bridge.run.access import RUNS
from bridge.run.directory import SCENARIO_FILE, RunDirectory
from bridge.scenario.model import Scenario
from lostlink.reading.ages import LinkTimes, link_ages, link_latencies, times_of
from lostlink.reading.frames import frame_of_columns, frame_of_rows, frame_of_table
from lostlink.reading.links.counts import link_counts, link_series
from lostlink.reading.lost_parts import in_words, lost_parts
from lostlink.reading.moved import scenario_of
from lostlink.reading.rows import RecordedDeliveries, named_links

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa

_BY_NAME = {table.name: table for table in TABLES}
LOGGED = names.Kind.LOGGED.value
"""The table that is made of streams."""


class NoRun(ValueError):
    """There is no run in a directory; the text says which, and what is missing."""


def load_run(run: str | Path) -> Run:
    """The run in the directory ``run`` (or in ``runs/`` below here, if ``run`` is a name there).

    Nothing but its scenario is looked for before it is asked for. An error in reading a record that another version
    of lostlink has made has a note that says so.

    Raises:
        NoRun: it is no run.
    """
    for path in (Path(run), RUNS / run):
        if (path / SCENARIO_FILE).is_file():
            return Run(path.resolve())
    raise NoRun(f"{run} is not the directory of a run (it has no {SCENARIO_FILE}), nor is {RUNS / run}")


class Run:
    """What a run left. Frames are read when they are first asked for, and kept.

    A run that was killed has all but its last second: its tables are read from journals, and what only the end of a
    run writes (``summary``) is empty. Frames are those of pandas (extra ``lostlink[pandas]``); `columns` and `table`
    do without.
    Units are in the names of columns; docs/reference/run-output.md has what each column means.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._directory = RunDirectory(path)

    def __repr__(self) -> str:
        return f"<Run {self.path.name}: {self.ending or 'without an end'}>"

    # --- what ran, and what came of it

    @cached_property
    def scenario(self) -> Scenario:
        """The scenario as resolved, with the files that it names where they lie now.

        Raises:
            OSError, ValueError: the file is not ours.
        """
        return scenario_of(self.path)

    @property
    def nodes(self) -> tuple[str, ...]:
        """Ids of all nodes, in the scenario's order; emitters come last."""
        return self.scenario.stations

    @cached_property
    def summary(self) -> dict[str, Any]:
        """`summary.json`; empty if the run was killed before it was written.

        Raises:
            OSError, ValueError: the file is not ours.
        """
        return self._directory.summary

    @property
    def ending(self) -> str:
        """``done``, ``duration``, ``interrupted`` or ``failed``; "" if it has no end."""
        return str(self.summary.get("ending", ""))

    @property
    def outcome(self) -> str:
        """``pass``, ``fail``, ``none``, ``interrupted`` or ``broke_off``; "" if it has no end."""
        return str(self.summary.get("outcome", ""))

    @property
    def verdict(self) -> str:
        """Whether what was measured agrees with the model, in words; "" if the run has no end."""
        return str(self.summary.get("verdict", ""))

    @property
    def digest(self) -> str:
        """SHA-256 over all that repeats; "" if the run has no end, or broke off with nothing that repeats."""
        has_any = self.summary.get("digests") != {}
        return str(self.summary.get("digest", "")) if has_any else ""

    @cached_property
    def reports(self) -> Reports:
        """Counters, events, and why the run may not repeat, of all its processes."""
        with version_noted(self.path):
            return read_reports(self.path)

    @cached_property
    def provenance(self) -> Provenance | None:
        """Versions and machine that made the record; None if it does not say."""
        return read_provenance(self.path)

    # --- frames

    @cached_property
    def truth(self) -> pd.DataFrame:
        """True states, a row per tick and node, each at its own instant (`sim_time_ns`)."""
        return frame_of_table(self.table(TRUTH.name), "sim_time_ns")

    @cached_property
    def states(self) -> pd.DataFrame:
        """What the autopilots say (Table I), a row per node at 10 Hz."""
        return frame_of_table(self.table(STATES.name), STATES.tick)

    @cached_property
    def agent_data(self) -> pd.DataFrame:
        """What agents logged, by tick and node, as columns ``tick_ns``, ``node``, ``name``, ``value`` (of any kind)."""
        rows = [
            {"tick_ns": tick_ns, "node": node, **item._asdict()}
            for tick_ns, node, item in self.logged()
            if isinstance(item, LoggedValue)
        ]
        return frame_of_rows(rows, ("tick_ns", "node", "name", "value"), "tick_ns")

    def agent_values(self, name: str) -> pd.DataFrame:
        """What agents logged under a name: ``tick_ns``, ``node``, and ``value`` or a column per key of mappings."""
        rows = []
        for tick_ns, node, item in self.logged():
            if isinstance(item, LoggedValue) and item.name == name:
                fields = item.value if isinstance(item.value, dict) else {"value": item.value}
                rows.append({"tick_ns": tick_ns, "node": node, **fields})
        return frame_of_rows(rows, ("tick_ns", "node"), "tick_ns")

    @cached_property
    def activities(self) -> pd.DataFrame:
        """What agents said of their work, as columns ``tick_ns``, ``node``, ``activity``, ``done``, ``failed``."""
        rows = [
            {"tick_ns": t, "node": node, "activity": r.activity, "done": r.done, "failed": r.failed}
            for t, node, r in self.logged()
            if isinstance(r, AgentStatus)
        ]
        return frame_of_rows(rows, ("tick_ns", "node", "activity", "done", "failed"), "tick_ns")

    @cached_property
    def packets(self) -> pd.DataFrame:
        """What became of packets, a row per packet and intended receiver."""
        return frame_of_table(self.table(DELIVERIES.name), DELIVERIES.tick)

    @cached_property
    def measurements(self) -> pd.DataFrame:
        """What RF sensors measured, a row per sensor, emitter in its band and measurement.

        Raises:
            ValueError: no node has a sensor.
        """
        return frame_of_table(self.table(MEASUREMENTS.name), MEASUREMENTS.tick)

    @cached_property
    def routes(self) -> pd.DataFrame:
        """By which nodes packets came where nodes hand them on: a row per hop of each that came another way.

        Raises:
            ValueError: no network of the run has routing.
        """
        return frame_of_table(self.table(ROUTES.name), ROUTES.tick)

    @cached_property
    def links(self) -> pd.DataFrame:
        """Counts of each directed link of each radio network: ``sent``, ``delivered`` and the causes of loss.

        Columns ``radio``, ``tx`` and ``rx`` name it.
        """
        return frame_of_columns(
            link_counts(self.path, self.scenario.transceiver_ids, self.scenario.network_names)
        )

    def link_series(self, period_s: float = 1.0) -> pd.DataFrame:
        """Each directed link over time: counts and mean power, SNR and PER of each period that had packets.

        Raises:
            ValueError: the period is below a nanosecond.
        """
        return frame_of_columns(
            link_series(
                self.path, self.scenario.transceiver_ids, round(period_s * 1e9), self.scenario.network_names
            ),
            "sim_time_ns",
        )

    @cached_property
    def ages(self) -> pd.DataFrame:
        """Age of information of each directed link that had a packet.

        Columns ``radio``, ``tx``, ``rx``, ``received``, ``mean_s``, ``p95_s``, ``peak_s``. The age is the time since
        the newest packet that the receiver has by this radio was transmitted, of sim time; a packet comes at the tick
        after the one that settled it (Kaul, Yates & Gruteser, INFOCOM 2012). It counts from the link's first packet,
        whatever became of that, to the end of the run. ``mean_s`` is the average over that time, ``p95_s`` what is not
        exceeded for 95 % of it, ``peak_s`` the greatest; ``received`` is how many packets came until the end.
        """
        return self._timed(lambda times: link_ages(times, self.end_ns))

    @cached_property
    def latencies(self) -> pd.DataFrame:
        """Sim time from transmission until an agent has the packet, of each directed link that had a packet.

        Columns ``radio``, ``tx``, ``rx``, ``delivered``, ``mean_s``, ``p95_s``, ``max_s``; nan where nothing came.
        """
        return self._timed(link_latencies)

    @cached_property
    def end_ns(self) -> int:
        """Sim time of the last tick of which there is a true state, ns; 0 without any."""
        if not TRUTH.is_in(self.path):
            return 0
        return int(self.columns(TRUTH.name, [TRUTH.tick])[TRUTH.tick].max(initial=0))

    @cached_property
    def inputs(self) -> pd.DataFrame:
        """What came from outside, a row per input, in the order of ``tick_ns``, then of nodes."""
        rows = [{"node": node, **to_fields(item)} for node, item in self._inputs()]
        return frame_of_rows(rows, ("tick_ns", "node", "kind", "link", "verb", "name"), "tick_ns")

    @cached_property
    def events(self) -> pd.DataFrame:
        """What the run's processes reported, as columns ``sim_time_ns``, ``node``, ``kind``, ``text``."""
        rows = [asdict(event) for event in self.reports.events]
        return frame_of_rows(rows, ("sim_time_ns", "node", "kind", "text"), "sim_time_ns")

    # --- beneath

    def columns(self, table: str, columns: Sequence[str] | None = None) -> dict[str, NDArray[Any]]:
        """Columns of a table as numpy arrays, without pandas; names as text.

        Args:
            table: ``truth``, ``states``, ``measurements``, ``deliveries``, ``routes`` or ``logged``.
            columns: which; all of them unless given.

        Raises:
            ValueError: there is no such table or column, or it is damaged.
            OSError: it cannot be read.
        """
        if table == LOGGED:
            found = self.table(table, columns)
            return {name: found.column(name).to_numpy() for name in found.column_names}
        chosen = _table(table)
        with version_noted(self.path):
            return read_columns(self.path, chosen, columns)

    def table(self, table: str, columns: Sequence[str] | None = None) -> pa.Table:
        """A table as Arrow; arguments and errors as of `columns`."""
        chosen = None if table == LOGGED else _table(table)
        with version_noted(self.path):
            return self._logged_table(columns) if chosen is None else read_arrow(self.path, chosen, columns)

    def _logged_table(self, columns: Sequence[str] | None) -> pa.Table:
        if not (self.path / LOGGED_FILE).exists():
            self._check_there(names.Kind.LOGGED)
        return read_logged(self.path, columns)

    def transmitted(self, node: str) -> Iterator[SentPacket]:
        """The packets that ``node`` gave to the radio, with their payloads; none if it has no such stream.

        Raises:
            ValueError: the run has no such node, or the file is damaged, or there no more.
        """
        self._check_node(node)
        self._check_there(str(names.packets(node)))
        return (packet for _, packet in packets_of(self.path, node))

    def logged(self) -> list[tuple[int, str, LoggedValue | AgentStatus]]:
        """What all agents logged and reported, as tick in ns, node and item; by tick, then by node.

        Raises:
            ValueError: a file is damaged, or there no more.
        """
        self._check_there(names.Kind.LOGGED, f"; {LOGGED_FILE} has the numbers and texts")
        found = [(t, node, item) for node in self.nodes for t, item in logged_of(self.path, node)]
        return sorted(found, key=lambda each: each[0])

    def mavlink(self, node: str, direction: Literal["from_autopilot", "to_autopilot"]) -> Iterator[Entry]:
        """MAVLink bytes of a UA by tick, in the direction given; none if it has no such stream.

        Raises:
            ValueError: the run has no such node, or the file is damaged, or there no more.
        """
        self._check_node(node)
        stream = names.Stream(names.Kind(direction), node)
        self._check_there(str(stream))
        return entries_of(stream.path(self.path))

    def _check_node(self, node: str) -> None:
        if node not in self.nodes:
            raise ValueError(f"no node has the id {node!r}; there are {', '.join(self.nodes)}")

    def _check_there(self, part: str, instead: str = "") -> None:
        """Refuse what is there no more; ``part`` is a stream, or what the names of several begin with."""
        lost = [each for each in lost_parts(self.path, self.summary) if f"{each}/".startswith(f"{part}/")]
        if lost:
            raise ValueError(f"{self.path}: the record has lost {in_words(lost)}{instead}")

    def _timed(self, figures: Callable[[Sequence[LinkTimes]], dict[str, NDArray[Any]]]) -> pd.DataFrame:
        scenario = self.scenario
        deliveries = RecordedDeliveries(self.path, scenario.transceiver_ids, scenario.network_names)
        times = times_of(deliveries)
        links = np.array([each.link for each in times], dtype=np.int64)
        return frame_of_columns({**named_links(links, deliveries), **figures(times)})

    def _inputs(self) -> list[tuple[str, RecordedInput]]:
        found = [(node, item) for node, items in all_inputs(self.path).items() for item in items]
        return sorted(found, key=lambda each: each[1].tick_ns)


def _table(name: str) -> Table:
    if name not in _BY_NAME:
        raise ValueError(f"no table {name!r}; there are {', '.join((*_BY_NAME, LOGGED))}")
    return _BY_NAME[name]
