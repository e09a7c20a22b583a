"""Which lostlink made each of several runs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from bridge.record.provenance import made_by


def others_made_by(runs: Sequence[Path]) -> dict[str, str]:
    """Version and commit of what made each record, by run; nothing if all are of one.

    Raises:
        OSError, ValueError: what made a record cannot be read.
    """
    found = {str(run): made_by(run) for run in runs}
    return found if len(set(found.values())) > 1 else {}
