"""`write_mcap`: the record of a run as one MCAP file, whether the run came to its end, was killed or still goes on."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from operator import itemgetter
from pathlib import Path
from typing import Final

from bridge.fleet.preflight.open_files import ask_for_open_files
from bridge.record.tables.reader import read_columns
from bridge.record.tables.truth import TRUTH
from bridge.run.directory import RunDirectory, name_in_utf8
from bridge.scenario.mcap import McapSettings
from bridge.scenario.model import Scenario
from lostlink.export.mcap.file import McapFile
from lostlink.export.mcap.mavlink import mavlink_sources
from lostlink.export.mcap.measured import MeasurementSource
from lostlink.export.mcap.motion import StateSource, TruthSource
from lostlink.export.mcap.radio import RadioSource, packets_source
from lostlink.export.mcap.said import agent_sources, events_source, text_sources
from lostlink.export.mcap.source import FOREVER_NS, Source
from lostlink.export.mcap.topics import prefixes

MCAP_FILE: Final = "run.mcap"
WINDOW_NS: Final = 5_000_000_000
"""Within a window messages are sorted; so much sim time is in memory."""
WINDOW_LINKS: Final = 2000
"""With more directed links than these windows are shorter: rows of deliveries go with the links."""
WINDOWS_MAX: Final = 100_000
"""A day of sim time of a hundred UA; a record that says it is longer has longer ones."""
OnProgress = Callable[[float], object]


def write_mcap(
    run: Path, path: Path, settings: McapSettings, on_progress: OnProgress = lambda _share: None
) -> dict[str, int]:
    """Write the record of the run in ``run`` to ``path``; returns the number of messages by topic.

    Args:
        run: the run directory.
        path: of the file.
        settings: what is to be in it.
        on_progress: called now and then with the share of sim time that is done.

    Raises:
        ValueError: a part of the record is damaged.
        OSError: a file cannot be read or written.
    """
    scenario = RunDirectory(run).scenario
    ask_for_open_files(len(scenario.transceivers))
    end_ns = _end_of(run)
    with McapFile(path, settings) as file:
        sources = list(_sources(run, file, scenario))
        window_ns = _window_ns(end_ns, len(scenario.transceiver_ids))
        for until_ns in (*range(window_ns, end_ns, window_ns), FOREVER_NS):
            items = [item for source in sources for item in source.until(until_ns)]
            items.sort(key=itemgetter(0))
            for time_ns, channel, data in items:
                channel.write(time_ns, data)
            on_progress(min(1.0, until_ns / end_ns) if end_ns else 1.0)
        file.add_metadata("lostlink", _about(run, scenario, file))
        return dict(file.counts)


def _sources(run: Path, file: McapFile, scenario: Scenario) -> Iterator[Source]:
    names = prefixes(scenario)
    yield TruthSource(run, file, names)
    if file.settings.has("state"):
        yield StateSource(run, file, names)
    if file.settings.has("measurements"):
        yield MeasurementSource(run, file, scenario, names)
    found: list[Source | None] = []
    for node, prefix in names.items():
        found += [*mavlink_sources(run, file, node, prefix), packets_source(run, file, node, prefix)]
    yield from (source for source in found if source is not None)
    yield from agent_sources(run, file, names)
    yield RadioSource(run, file, scenario)
    events = events_source(run, file)
    if events is not None:
        yield events
    yield from text_sources(run, file)


def _end_of(run: Path) -> int:
    """The last tick that has truth; 0 if there is none."""
    if not TRUTH.is_in(run):
        return 0
    ticks_ns = read_columns(run, TRUTH, (TRUTH.tick,))[TRUTH.tick]
    return int(ticks_ns[-1]) if len(ticks_ns) else 0


def _window_ns(end_ns: int, nodes: int) -> int:
    """Of a record that ends at an instant, of so many nodes."""
    return max(WINDOW_NS * WINDOW_LINKS // max(nodes**2, WINDOW_LINKS), end_ns // WINDOWS_MAX)


def _about(run: Path, scenario: Scenario, file: McapFile) -> dict[str, str]:
    found = {
        "run": name_in_utf8(run),
        "scenario": scenario.to_yaml(),
        "left_out": json.dumps(dict(sorted(file.left_out.items()))),
    }
    summary = RunDirectory(run).summary
    if summary:
        found["summary"] = json.dumps({key: value for key, value in summary.items() if key != "bins"})
    return found
