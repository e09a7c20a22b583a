"""A file that has one JSON object."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from bridge.run.whole_file import whole_file


def read_object(file: Path, mistake: str) -> dict[str, Any]:
    """What the object of a file has.

    Args:
        file: the file.
        mistake: what it is if it has no object.

    Raises:
        OSError: it cannot be read.
        ValueError: it has none; the text has the file, the mistake and why.
    """
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{file}: {mistake}: {error}") from error
    if not isinstance(content, dict):
        raise ValueError(f"{file}: {mistake}: a JSON object is expected")
    return content


def write_object(file: Path, content: Mapping[str, Any]) -> None:
    """Write a file that has one JSON object: all of it, or what was there before stays.

    Raises:
        OSError: it cannot be written.
    """
    with whole_file(file) as partial:
        partial.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
