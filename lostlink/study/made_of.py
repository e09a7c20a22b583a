"""What a run of a study is made of besides its resolved scenario, and in what that is other than it was."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache, reduce
from operator import getitem
from pathlib import Path
from typing import Any, Final

from bridge.record.digests import digest_now
from bridge.record.provenance import git_commit, lostlink_told, version_of
from bridge.scenario.model import Scenario
from bridge.scenario.resolve.named_files import Named, digest_of_plain

NOT_OF_THE_RESULT: Final = ("ports", "processes", "zenoh", "hosts", "speed", "figure", "mcap", "mavlink.tlog")
"""Keys of a scenario that change no result."""


@dataclass(frozen=True, slots=True)
class MadeOf:
    """What a run is made of.

    Attributes:
        id: of all of it, with the scenario; "" if that is not known.
        lostlink: its version, and its commit if it is a checkout.
        files: SHA-256 of those that the scenario names and of what these name or import, by path.
        packages: versions of installed ones that these import, by name.
    """

    id: str = ""
    lostlink: str = ""
    files: Mapping[str, str] = field(default_factory=dict)
    packages: Mapping[str, str] = field(default_factory=dict)

    def changes_since(self, then: MadeOf) -> str:
        """In what this is other than it was, in words; files go by name and content, wherever they lie."""
        if not then.lostlink:
            return "what these were made of is not known"
        old, new = _contents(then), _contents(self)
        names = sorted({name for name, _ in new - old} or {name for name, _ in old - new})
        changes = [f"other files ({', '.join(names)})"] if names else []
        changes += [
            f"{name} {self.packages[name]} in place of {version or 'none'}"
            for name in self.packages
            if (version := then.packages.get(name, "")) != self.packages[name]
        ]
        if self.lostlink != then.lostlink:
            changes.append(f"{self.lostlink} in place of {then.lostlink}")
        return ", ".join(changes) or "another scenario, or other settings"


def _contents(made: MadeOf) -> set[tuple[str, str]]:
    return {(Path(path).name, digest) for path, digest in made.files.items()}


class Looker:
    """Looks what runs are made of; each file is read once."""

    def __init__(self) -> None:
        self._digest_of = cache(digest_now)
        self._named = Named(self._digest_of)  # many runs name the same files

    def made_of(self, scenario: Scenario) -> MadeOf:
        """What the run of a resolved scenario is made of now; the same makes the same id, wherever files lie.

        Raises:
            OSError: a file cannot be read.
        """
        content = scenario.model_dump(mode="json", by_alias=True)
        for key in NOT_OF_THE_RESULT:
            *parents, name = key.split(".")
            del reduce(getitem, parents, content)[name]
        named, lostlink = self._named.anew(), lostlink_told(version_of("lostlink"), git_commit())
        whole: dict[str, Any] = {"lostlink": lostlink, "scenario": named.in_place(content)}
        files = {str(path): self._digest_of(path) for path in sorted(named.files)}
        return MadeOf(digest_of_plain(whole)[:16], lostlink, files, dict(sorted(named.packages.items())))
