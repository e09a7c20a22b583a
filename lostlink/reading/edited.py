"""What a run's radios name, and is another now than when it was flown, or may be: models, maps, settings, presets."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from bridge.record.digests import digest_if_readable
from bridge.record.provenance import git_commit, lostlink_told, made_by, read_provenance, version_of
from bridge.scenario.document.files import YAML
from bridge.scenario.model import Scenario
from bridge.scenario.resolve.named_files import Named

OF_RADIOS: Final = ("radio", "networks", "antenna")
"""Keys of a scenario, and of its nodes and emitters, below which files decide on packets."""


def radio_files(scenario: Scenario) -> dict[str, str]:
    """SHA-256 of what the scenario's radios name, and of what these name or import in their turn, by path."""
    named = Named()
    named.in_place(list(_radios(scenario.model_dump(mode="json", by_alias=True))), [Path()])
    return {str(path): digest_if_readable(path) for path in sorted(named.files)}


def edited_files(run: Path, files: Mapping[str, str]) -> list[str]:
    """Those that are others now (SHA-256 by path) than the record in ``run`` says, as sentences.

    Raises:
        OSError, ValueError: what made the record cannot be read.
    """
    made = read_provenance(run)
    if made is None:
        return []
    return [
        f"{path} is another than that of the record"
        for path, digest in files.items()
        if made.files.get(path, digest) != digest
    ]


def presets_of_today(run: Path, recorded: Scenario, decided: Scenario) -> list[str]:
    """Presets of the record that are read as this lostlink has them, which did not make it: a sentence, or none.

    Args:
        run: directory of the record, which has copies of files, but not of what ships.
        recorded: its scenario.
        decided: the scenario whose radios are made; presets that only this one names are asked for as they are.

    Raises:
        OSError, ValueError: what made the record cannot be read.
    """
    by, now = made_by(run), lostlink_told(version_of("lostlink"), git_commit())
    names = sorted(_presets(recorded) & _presets(decided))
    return [f"{', '.join(names)}: preset as of {now}; {by} made the record"] if names and by != now else []


def _presets(scenario: Scenario) -> set[str]:
    """Names of those that ship."""
    nodes = [node.model_dump(mode="json", by_alias=True) for node in scenario.nodes]
    nodes += [node["sensor"] for node in nodes if node.get("sensor")]
    radios = [scenario.radio, *scenario.networks.values(), *(node.get("radio") for node in nodes)]
    names = [radio.get("preset") if isinstance(radio, dict) else radio for radio in radios]
    return {name for name in names if isinstance(name, str) and Path(name).suffix not in YAML}


def _radios(scenario: dict[str, Any]) -> Iterator[Any]:
    for part in (scenario, *scenario["nodes"]):
        yield from (part[key] for key in OF_RADIOS if key in part)
