"""Measures of one's own that a run is judged by: `acceptance.yaml` names them."""

from __future__ import annotations

from lostlink import Run


def fastest_climb_mps(run: Run, node: str) -> float:
    """The greatest true rate of climb of a node."""
    truth = run.columns("truth", ("node", "velocity_down_mps"))
    return float(-truth["velocity_down_mps"][truth["node"] == node].min())
