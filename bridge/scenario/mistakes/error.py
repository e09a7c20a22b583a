"""The error that a wrong scenario is refused with."""

from __future__ import annotations


class ScenarioError(ValueError):
    """The scenario cannot be used; ``str(error)`` has one line per mistake, each with its place."""
