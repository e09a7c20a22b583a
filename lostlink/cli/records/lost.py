"""Commands that make something of a part of a record say what of that is there no more."""

from __future__ import annotations

from collections.abc import Collection
from contextlib import suppress
from pathlib import Path

from bridge.run.directory import RunDirectory
from lostlink.cli.exits import tell
from lostlink.reading.lost_parts import in_words, lost_parts


def tell_lost(run: Path, wanted: Collection[str], so: str) -> None:
    """Warn of tables and streams that the record of ``run`` has lost.

    Args:
        run: the run directory; of one whose summary is missing or damaged nothing is known.
        wanted: names of tables, and kinds of streams, that are made use of.
        so: what comes of it.

    Raises:
        OSError: it cannot be looked through.
    """
    with suppress(ValueError):
        lost = [part for part in lost_parts(run, RunDirectory(run).summary) if part.split("/")[0] in wanted]
        if lost:
            tell(f"warning: {run}: the record has lost {in_words(lost)}: {so}")
