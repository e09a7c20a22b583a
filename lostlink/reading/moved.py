"""Files that a record names and that lie elsewhere now: code, winds and airframes of a run that came from elsewhere.

A record has their absolute paths and the digests of what they held (`provenance.json`). One that is no more there is
looked for by the end of its path below the folders around the run's directory, and below the working directory: it
counts only if its content is that of the record. In a folder that the user names, it counts in any case.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from functools import cached_property
from pathlib import Path

from bridge.record.digests import digest_if_readable
from bridge.record.provenance import read_provenance, version_noted
from bridge.run.directory import RunDirectory
from bridge.scenario.model import Scenario

CODE = ".py"


class Moved:
    """Where files of one record lie now.

    Args:
        run: the run's directory.
        folder: where they lie, as the user says; None: nothing was said.

    Attributes:
        found: by their recorded paths, those that were found elsewhere.
        missing: those that were not found.
    """

    def __init__(self, run: Path, folder: Path | None = None) -> None:
        self._run, self._folder = run.absolute(), None if folder is None else folder.absolute()
        self._there: set[Path] = set()
        self.found: dict[Path, Path] = {}
        self.missing: dict[Path, None] = {}

    def find(self, text: str) -> str:
        """The same path (or ``FILE.py:NAME``), or where it lies now if it can be found there."""
        file, colon, name = text.rpartition(":")
        file, name = (file, colon + name) if file.endswith(CODE) else (text, "")
        path = Path(os.path.normpath(file))
        if path not in self._there:
            self._look_for(path)
        return f"{self.found[path]}{name}" if path in self.found else text

    @property
    def looked_in(self) -> list[Path]:
        """The folders below which files are looked for."""
        named = [] if self._folder is None else [self._folder]
        return list(dict.fromkeys([*named, *self._run.parents[:-1], Path.cwd()]))

    @property
    def folders(self) -> dict[Path, Path]:
        """By recorded folder, the one that now has its files: but for the end that two paths have in common."""
        pairs = {}
        for old, new in self.found.items():
            last = sum(1 for _ in _same_ends(old, new)) - 1
            pairs[old.parents[last]] = new.parents[last]
        return pairs

    def renamed(self, files: Mapping[str, str]) -> dict[str, str]:
        """Digests by recorded path, by the paths that the files have now."""
        folders = self.folders
        return {str(_moved_along(Path(os.path.normpath(p)), folders)): digest for p, digest in files.items()}

    def _look_for(self, path: Path) -> None:
        self._there.add(path)
        if os.path.exists(path):  # noqa: PTH110 (also of a text that is too long for a name)
            return
        place = self._place(path)
        if place is None:
            self.missing[path] = None
        else:
            self.found[path] = place

    def _place(self, path: Path) -> Path | None:
        wanted = self._recorded.get(str(path))
        for folder in self.looked_in:
            places = [folder.joinpath(*path.parts[begin:]) for begin in range(1, len(path.parts))]
            there = [place for place in places if place != path and _is_file(place)]
            same = [place for place in there if wanted and digest_if_readable(place) == wanted]
            if same or (there and folder == self._folder):
                return [*same, *there][0]
        return None

    @cached_property
    def _recorded(self) -> Mapping[str, str]:
        """Digests by recorded path."""
        made = read_provenance(self._run)
        return {} if made is None else {os.path.normpath(path): one for path, one in made.files.items()}


def _is_file(place: Path) -> bool:
    """Whether there is a file; False of a folder that we may not look into."""
    return os.path.isfile(place)  # noqa: PTH113


def scenario_of(run: Path) -> Scenario:
    """The scenario of a record as resolved, with the files that it names where they lie now.

    Raises:
        OSError, ValueError: it is not there or not ours.
    """
    with version_noted(run):
        return RunDirectory(run).scenario_with(Moved(run).find)


def _moved_along(path: Path, folders: Mapping[Path, Path]) -> Path:
    places = [new / path.relative_to(old) for old, new in folders.items() if path.is_relative_to(old)]
    return next((place for place in places if _is_file(place)), path)


def _same_ends(old: Path, new: Path) -> Iterator[str]:
    for one, other in zip(reversed(old.parts), reversed(new.parts), strict=False):
        if one != other:
            return
        yield one
