"""From streams, reports and logs: what agents logged and said, what happened, and what was logged as text."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from bridge.bus.messages import AgentStatus, encode
from bridge.bus.messages.sequences import aligned
from bridge.record.events import read_reports
from bridge.record.logged import LoggedValue, logged_of
from bridge.run.directory import LOG_FOLDER
from lostlink.export.mcap.file import McapFile
from lostlink.export.mcap.source import Feed, Item
from lostlink.export.mcap.topics import named_chunk, unique
from lostlink.export.mcap.values import ValueType, at_times, kind_of, merged, type_name, unique_type

LOG_TYPE: Final = "rcl_interfaces/msg/Log"
_LEVELS: Final = {"DEBUG": 10, "INFO": 20, "WARNING": 30, "ERROR": 40, "CRITICAL": 50}
_INFO: Final = 20
_LINE: Final = re.compile(
    r"\S+ \S+ (?:-|(?P<time>[0-9.]+)s) (?P<level>[A-Z]+) (?P<logger>[\w.]+): (?P<text>.*)"
)
_PACKAGE: Final = "lostlink_logged/msg"


def agent_sources(run: Path, file: McapFile, prefixes: dict[str, str]) -> Iterator[Feed]:
    """What the agents logged and reported."""
    settings, known = file.settings, _Types()
    for node, prefix in prefixes.items():
        types = _types_of(run, node, known) if settings.has("log") else {}
        file.schemas.add({each.name: each.definition for each in types.values()})
        yield Feed(_agent_items(run, file, node, prefix, types))


class _Types:
    """Types by their fields: nodes that log the same under a name share one."""

    def __init__(self) -> None:
        self._found: dict[tuple[str, tuple[tuple[str, str], ...]], ValueType] = {}
        self._taken: set[str] = set()

    def of(self, name: str, kinds: dict[str, str]) -> ValueType:
        """The type of values logged as ``name``, with fields of these kinds."""
        key = (type_name(name), tuple(kinds.items()))
        if key not in self._found:
            self._found[key] = ValueType(f"{_PACKAGE}/{unique_type(key[0], self._taken)}", kinds)
        return self._found[key]


def _types_of(run: Path, node: str, known: _Types) -> dict[str, ValueType]:
    """The types of a node's values, by their names: from all that there are."""
    kinds: dict[str, dict[str, str]] = {}
    messages, given = Counter[str](), Counter[tuple[str, str]]()
    for _, item in logged_of(run, node):
        if isinstance(item, LoggedValue):
            messages[item.name] += 1
            fields = kinds.setdefault(item.name, {})
            for key, value in _fields(item).items():
                given[item.name, key] += 1
                kind = kind_of(value)
                fields[key] = merged(fields.get(key, kind), kind)
    for name, fields in kinds.items():
        lacking = [key for key in fields if given[name, key] < messages[name]]
        fields.update({key: at_times(fields[key]) for key in lacking})
    return {name: known.of(name, fields) for name, fields in kinds.items()}


def _fields(item: LoggedValue) -> dict[str, object]:
    return dict(item.value) if isinstance(item.value, dict) else {"value": item.value}


def _agent_items(
    run: Path, file: McapFile, node: str, prefix: str, types: dict[str, ValueType]
) -> Iterator[Item]:
    topics: dict[str, str] = {}
    for tick_ns, item in logged_of(run, node):
        if isinstance(item, AgentStatus):
            if file.settings.has("agent"):
                channel = file.channel(f"/{prefix}/agent", AgentStatus.TYPE, "agent")
                yield tick_ns, channel, encode(item)
        elif item.name in types:
            if item.name not in topics:
                name = unique(named_chunk(item.name), set(topics.values()))
                topics[item.name] = name
            kind = types[item.name]
            channel = file.channel(f"/{prefix}/log/{topics[item.name]}", kind.name, "log")
            yield tick_ns, channel, kind.encode(tick_ns, node, _fields(item))


def events_source(run: Path, file: McapFile) -> Feed | None:
    """The events of all processes; None if they are not wanted."""
    if not file.settings.has("events"):
        return None
    channel = file.channel("/events", LOG_TYPE, "events")
    return Feed(
        (
            event.sim_time_ns,
            channel,
            log_message(event.sim_time_ns, _INFO, event.kind, event.text, event.node),
        )
        for event in read_reports(run).events
    )


def text_sources(run: Path, file: McapFile) -> Iterator[Feed]:
    """The logs of nodes and processes, as far as they have sim time; those of autopilots have none."""
    if not file.settings.has("text"):
        return
    channel = file.channel("/rosout", LOG_TYPE, "text")
    for path in sorted((run / LOG_FOLDER).glob("*.log")):
        if not path.name.startswith("autopilot"):
            lines = _lines(path)
            yield Feed(
                (t, channel, log_message(t, lvl, name, text, path.stem)) for t, lvl, name, text in lines
            )


def _lines(path: Path) -> Iterator[tuple[int, int, str, str]]:
    """Sim time, level, logger and text of each line; times never go back."""
    time_ns = 0
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
        match = _LINE.fullmatch(line)
        if match is None:
            yield time_ns, _INFO, path.stem, line
            continue
        time_ns = max(time_ns, round(float(match["time"] or 0.0) * 1e9))
        yield time_ns, _LEVELS.get(match["level"], _INFO), f"{path.stem}.{match['logger']}", match["text"]


def log_message(time_ns: int, level: int, name: str, text: str, source: str) -> bytes:
    """A rcl_interfaces/Log in CDR; ``source`` is its file."""
    whole = bytearray(b"\0\1\0\0")

    def add(formats: str, *values: int) -> None:
        whole.extend(aligned("<", formats)[(len(whole) - 4) & 7].pack(*values))

    add("iIB", time_ns // 1_000_000_000, time_ns % 1_000_000_000, level)
    for each in (name, text, source, ""):
        raw = each.encode(errors="replace").replace(b"\0", b"?") + b"\0"
        add("I", len(raw))
        whole.extend(raw)
    add("I", 0)
    return bytes(whole)
