"""How commands are told a run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from bridge.run.access import place_of


class RunPath(click.Path):
    """The directory of a run, or its name in `runs/`. Options as of `click.Path`."""

    def __init__(self, **options: Any) -> None:
        super().__init__(path_type=Path, **options)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """What lies there, else what has that name in `runs/`."""
        found = value if Path(value).exists() else place_of(value) or value
        return super().convert(found, param, ctx)
