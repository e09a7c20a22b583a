"""What a process of a run has to report: counters, events, and why the run may not repeat.

What wall time decided, and errors that must not vanish, go to `reports/<process>.json`; `read_reports` merges the
files of a run.
"""

from __future__ import annotations

import json
import threading
from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from bridge.record.names import REPORT_FOLDER, as_seen_from, report_path
from bridge.run.json_object import write_object

EVENTS_MAX = 1000
"""Events (and reasons) that one process keeps; later ones are only counted, as ``events_not_kept``."""
NOT_KEPT = "events_not_kept"
UNREADABLE = "unreadable_report"
"""Kind of the event that stands for a report which cannot be read."""
DIED = "died"
"""Kind of the event that a process of the run ended by itself before the run did."""
KILLED = "killed"
"""Kind of the event that a process was killed because it did not end in time: what it wrote may lack its end."""

AGENT_BLOCKED = "agent_blocked"
"""Kind of the event that an agent is at work on a tick for long by wall time, and all the run waits for it."""
RADIO_BLOCKED = "radio_blocked"
"""Kind of the event that the radio is at the packets of a tick for long by wall time, and all the run waits for it."""
AGENT_WARNING = "agent_warning"
"""Kind of the event that an agent does what its author cannot want."""
OTHER_SYSTEM = "other_system"
"""Kind of the event that a UA's autopilot has another system id than the UA."""
PROCESS_LEFT = "process_left"
"""Kind of the event that a process which an agent had started was ended with the run."""

WHOSE = {AGENT_WARNING: "the agent of ", AGENT_BLOCKED: "the agent of ", OTHER_SYSTEM: ""}
"""By kind, of events that somebody must see while the run goes on: what stands before the name of the node."""


def transmits_freely(node: str) -> str:
    """Why a run may not repeat as which a program beside it transmitted."""
    return f"a program that the clock does not wait for transmits as node {node}"


@dataclass(frozen=True, slots=True)
class RunEvent:
    """Something that happened at an instant of sim time; ``node`` is "" if it is nobody's in particular."""

    sim_time_ns: int
    node: str
    kind: str
    text: str


@dataclass(frozen=True, slots=True)
class Reports:
    """What all processes of a run reported.

    Attributes:
        counters: by process, then by name.
        events: sorted by sim time, of one instant by node.
        may_not_repeat: sentences, each once: why the same run may come out differently.
    """

    counters: dict[str, dict[str, int]]
    events: tuple[RunEvent, ...]
    may_not_repeat: tuple[str, ...]

    def as_dict(self) -> dict[str, Any]:
        """In plain types, as `summary.json` has it."""
        return asdict(self)


class Report:
    """Collects what one process reports; any thread may call any method.

    Args:
        run: the run directory.
        process: name of the process.

    Raises:
        ValueError: the name cannot be part of a file name.
    """

    def __init__(self, run: Path, process: str) -> None:
        self._run, self._path = run, report_path(run, process)
        self._lock = threading.Lock()
        self._file_lock = threading.Lock()
        self._counters: Counter[str] = Counter()
        self._events: list[RunEvent] = []
        self._reasons: dict[str, None] = {}
        self._changed = True

    def count(self, name: str, by: int = 1) -> None:
        """Add to a counter."""
        with self._lock:
            self._counters[name] += by
            self._changed = True

    def set_counters(self, values: Mapping[str, int]) -> None:
        """Give counters that are kept elsewhere their present values."""
        with self._lock:
            self._counters.update({name: value - self._counters[name] for name, value in values.items()})
            self._changed = True

    def event(self, sim_time_ns: int, node: str, kind: str, text: str) -> None:
        """Report what happened; paths of the run's files are told as seen from its directory."""
        text = as_seen_from(self._run, text)
        with self._lock:
            if len(self._events) < EVENTS_MAX:
                self._events.append(RunEvent(sim_time_ns, node, kind, text))
            else:
                self._counters[NOT_KEPT] += 1
            self._changed = True

    def may_not_repeat(self, reason: str) -> None:
        """Report, as a sentence, why the same run may come out differently. The same sentence counts once."""
        with self._lock:
            if reason in self._reasons:
                return
            if len(self._reasons) < EVENTS_MAX:
                self._reasons[reason] = None
            else:
                self._counters[NOT_KEPT] += 1
            self._changed = True

    def flush(self) -> None:
        """Write the file in one step, if there is anything new: a killed process leaves what was flushed.

        Raises:
            OSError: it cannot be written; what is new stays new.
        """
        with self._file_lock:
            with self._lock:
                if not self._changed:
                    return
                self._changed = False
                content = self._content()
            try:
                self._path.parent.mkdir(parents=True, exist_ok=True)
                write_object(self._path, content)
            except OSError:
                with self._lock:
                    self._changed = True
                raise

    def close(self) -> None:
        """Write the file for the last time."""
        self.flush()

    def _content(self) -> dict[str, Any]:
        return {
            "counters": dict(sorted(self._counters.items())),
            "events": [asdict(event) for event in self._events],
            "may_not_repeat": list(self._reasons),
        }


def read_reports(run: Path) -> Reports:
    """What the processes of the run in ``run`` reported. A report that cannot be read becomes an event."""
    counters: dict[str, dict[str, int]] = {}
    events: list[RunEvent] = []
    reasons: dict[str, None] = {}
    for file in sorted((run / REPORT_FOLDER).glob("*.json")):
        try:
            own_counters, own_events, own_reasons = _read(file)
        except (
            OSError,
            ValueError,
            TypeError,
            KeyError,
            AttributeError,
            OverflowError,
            RecursionError,
        ) as error:
            events.append(RunEvent(0, "", UNREADABLE, f"{file}: cannot be read: {error}"))
            continue
        counters[file.stem] = own_counters
        events += own_events
        reasons |= dict.fromkeys(own_reasons)
    events.sort(key=lambda e: (e.sim_time_ns, len(e.node), e.node))  # whichever process told of it, and when
    return Reports(counters, tuple(events), tuple(reasons))


def _read(file: Path) -> tuple[dict[str, int], list[RunEvent], list[str]]:
    content = json.loads(file.read_text(encoding="utf-8"))
    counters = {str(name): int(value) for name, value in content["counters"].items()}
    events = [
        RunEvent(int(e["sim_time_ns"]), str(e["node"]), str(e["kind"]), str(e["text"]))
        for e in content["events"]
    ]
    return counters, events, [str(reason) for reason in content["may_not_repeat"]]
