"""Files of an agent's own in the run directory: a line of JSON per record, with sim time."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, TextIO

from bridge.agents.commands import plain
from bridge.bus.keys import checked_chunk


class OwnFiles:
    """The files of one node's agent; nothing is made before it is used.

    Args:
        folder: where they go; ``None`` where there is no run directory (a test, say): then nothing is kept.
    """

    def __init__(self, folder: Path | None) -> None:
        self._folder = folder
        self._open: dict[str, TextIO] = {}

    @property
    def folder(self) -> Path:
        """The agent's own folder in the run directory, made when it is first asked for.

        Raises:
            FileNotFoundError: there is no run directory.
            OSError: it cannot be made.
        """
        if self._folder is None:
            raise FileNotFoundError("there is no run directory here")
        self._folder.mkdir(parents=True, exist_ok=True)
        return self._folder

    def write(self, name: str, sim_time_ns: int, fields: dict[str, Any]) -> None:
        """Append ``{"sim_time_s": ..., **fields}`` to ``<name>.jsonl``.

        Raises:
            ValueError: ``name`` is no file name.
            TypeError: a field is nothing that JSON knows.
            OSError: the file cannot be written.
        """
        checked_chunk(name)
        line = json.dumps({"sim_time_s": sim_time_ns / 1e9, **fields}, default=plain)
        if self._folder is None:
            return
        if name not in self._open:
            self._open[name] = (self.folder / f"{name}.jsonl").open("w", encoding="utf-8", buffering=1)
        self._open[name].write(line + "\n")

    def close(self) -> None:
        """Close all of them."""
        for file in self._open.values():
            file.close()
        self._open.clear()
