"""Calls of a user's functions: one that raises is logged and counted, and the daemon keeps working."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any

_log = logging.getLogger(__name__)


class Callbacks:
    """Calls functions that are not ours."""

    def __init__(self) -> None:
        self.errors = 0
        """How many calls raised."""

    def call(self, name: str, function: Callable[..., object] | None, *arguments: Any) -> None:
        """Call ``function``, if there is one; ``name`` is for the log."""
        if function is None:
            return
        try:
            function(*arguments)
        except Exception:
            self.errors += 1
            _log.exception("%s failed", name)
