"""Which lostlink made each of several runs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from bridge.record.provenance import read_provenance

NOT_KNOWN: Final = "it is not known what"


def made_by(run: Path) -> str:
    """Version and commit, for people, of what made the record in ``run``.

    Raises:
        OSError, ValueError: what made the record cannot be read.
    """
    made = read_provenance(run)
    return NOT_KNOWN if made is None else made.made_by


def others_made_by(runs: Sequence[Path]) -> dict[str, str]:
    """The same by run; nothing if all are of one.

    Raises:
        OSError, ValueError: as `made_by`.
    """
    found = {str(run): made_by(run) for run in runs}
    return found if len(set(found.values())) > 1 else {}
