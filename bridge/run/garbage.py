"""How often Python looks for garbage in a process of ours."""

from __future__ import annotations

import gc

THRESHOLD = 50_000
"""Imports, files and frames make many objects, few of them garbage that has to be looked for: what Python has by default
would look every few frames, and a dozen times a second through all that was imported."""


def look_rarely() -> None:
    """Look for garbage when there are so many new objects; before imports, as these make most."""
    gc.set_threshold(THRESHOLD)
