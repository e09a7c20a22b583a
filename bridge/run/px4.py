"""Where a real PX4 lies on this machine."""

from __future__ import annotations

import json
import lzma
import os
import shutil
from collections.abc import Mapping
from functools import cache
from pathlib import Path

HOME_VARIABLE = "PX4_HOME"
BUILD = Path("build") / "px4_sitl_default"


def px4_places(environment: Mapping[str, str], directory: Path | None = None) -> list[Path]:
    """Where ``px4`` is looked for besides PATH.

    Args:
        environment: its PX4_HOME is PX4's checkout, or the folder of its build.
        directory: another such, looked at first.
    """
    roots = [Path(root) for root in (directory, environment.get(HOME_VARIABLE)) if root]
    return [root / folder / "bin" / "px4" for root in roots for folder in (".", BUILD)]


def find_px4(environment: Mapping[str, str], directory: Path | None = None) -> Path | None:
    """Path of ``px4``, beside whose folder lies ``etc`` with PX4's start scripts; None: it is nowhere."""
    on_path = shutil.which("px4", path=environment.get("PATH"))
    for place in (*px4_places(environment, directory), *([Path(on_path)] if on_path else [])):
        if os.access(place, os.X_OK) and (etc_of(place.resolve()) / "init.d-posix").is_dir():
            return place.resolve()
    return None


def etc_of(binary: Path) -> Path:
    """The folder with PX4's start scripts and what describes its build."""
    return binary.parents[1] / "etc"


def px4_events_file(binary: Path) -> Path | None:
    """What PX4's events mean, as its build describes them; None: it does not."""
    file = etc_of(binary) / "extras" / "all_events.json.xz"
    return file if file.is_file() else None


@cache
def whole_parameters(binary: Path) -> frozenset[str]:
    """Names of its parameters that are whole numbers, as its build describes them; empty: it does not."""
    file = etc_of(binary) / "extras" / "parameters.json.xz"
    try:
        listed = json.loads(lzma.decompress(file.read_bytes()))["parameters"]
        return frozenset(one["name"] for one in listed if one["type"] == "Int32")
    except (OSError, lzma.LZMAError, ValueError, KeyError, TypeError):
        return frozenset()
