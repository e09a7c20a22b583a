"""A ground station that says its words at given instants of sim time: nothing hangs on how fast the machine is."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mav

from bridge.fleet.autopilots.dirs import AutopilotDirs
from bridge.record.names import Kind, Stream, inputs_path
from bridge.record.streams import read_stream
from bridge.run.directory import RunDirectory
from bridge.scenario.file import parse_scenario
from lostlink.flight.flight import Flight, Watcher

Said = list[tuple[float, Any]]
NS_PER_S = 1_000_000_000
TICK_NS = 50_000_000


def flown(
    scenario: str, folder: Path, said: Said, *, radio: str = "telemetry", ardupilot: Path | None = None
) -> tuple[Path, dict[str, Any]]:
    """Fly a scenario with a station at the modem of its node ``gcs``; returns the run's directory and summary.

    Args:
        scenario: as YAML.
        folder: for the run, and for what the station says.
        said: instants, s, and messages; beside these it sends a heartbeat each second.
        radio: that its modem is at.
        ardupilot: where real ones are.
    """
    parsed = parse_scenario(scenario, "scripted.yaml", folder)
    script = folder / f"{parsed.name}-script"
    beats: Said = [
        (second, mav.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
        for second in range(1, int(parsed.duration_s))
    ]
    _write(inputs_path(script, "gcs"), radio, [*beats, *said])
    run = RunDirectory.create(folder / "runs", parsed.name)
    summary = Flight(parsed, run, Watcher()).fly(AutopilotDirs(ardupilot), script, takes_signals=False)
    assert summary["ending"] == "duration", summary["error"]
    assert summary["may_not_repeat"] == []
    return run.path, summary


def _write(path: Path, radio: str, said: Said) -> None:
    path.parent.mkdir(parents=True)
    sender = mav.MAVLink(None, srcSystem=255, srcComponent=190)
    with path.open("w") as file:
        for at_s, message in sorted(said, key=lambda one: one[0]):
            data = bytes(message.pack(sender))
            sender.seq = (sender.seq + 1) & 0xFF
            tick_ns = round(at_s * NS_PER_S / TICK_NS) * TICK_NS
            line = {"tick_ns": tick_ns, "kind": "serial", "radio": radio, "hex": data.hex()}
            file.write(json.dumps(line) + "\n")


def messages(path: Path) -> Iterator[tuple[float, Any]]:
    """Messages of a stream with their instants, s."""
    reader = mav.MAVLink(None)
    reader.robust_parsing = True
    for entry in read_stream(path):
        for message in reader.parse_buffer(entry.payload) or []:
            yield entry.tick_ns / NS_PER_S, message


def out_of(run: Path, node: str, kinds: str | Sequence[str], radio: str = "telemetry") -> Said:
    """Messages of some kinds that came out of a node's modem, with their instants, s."""
    wanted = [kinds] if isinstance(kinds, str) else kinds
    path = Stream(Kind.FROM_MODEM, node, radio).path(run)
    return [(at_s, message) for at_s, message in messages(path) if message.get_type() in wanted]
