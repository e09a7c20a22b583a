"""Files that a run's radios name, and that are others now than when it was flown: models, maps, settings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from bridge.record.digests import digest_if_readable
from bridge.record.provenance import read_provenance
from bridge.scenario.model import Scenario
from bridge.scenario.resolve.named_files import Named

OF_RADIOS: Final = ("radio", "networks", "antenna")
"""Keys of a scenario, and of its nodes and emitters, below which files decide on packets."""


def radio_files(scenario: Scenario) -> dict[str, str]:
    """SHA-256 of what the scenario's radios name, and of what these name or import in their turn, by path."""
    named = Named()
    named.in_place(list(_radios(scenario.model_dump(mode="json", by_alias=True))), Path())
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


def _radios(scenario: dict[str, Any]) -> Iterator[Any]:
    for part in (scenario, *scenario["nodes"]):
        yield from (part[key] for key in OF_RADIOS if key in part)
