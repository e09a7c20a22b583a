"""How often Python looks for garbage in a process of ours."""

from __future__ import annotations

import atexit
import gc

THRESHOLD = 50_000
"""Imports, files and frames make many objects, and little garbage that has to be looked for: Python's default would
look every few frames, and again and again through all that was imported."""


def look_rarely() -> None:
    """Look for garbage when there are so many new objects, and at the end for none; before imports, which make most."""
    gc.set_threshold(THRESHOLD)
    atexit.register(gc.freeze)  # the interpreter's end would look through everything, several times
