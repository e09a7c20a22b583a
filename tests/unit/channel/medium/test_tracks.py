"""Positions and velocities of tracks between truth samples."""

import numpy as np
import pytest

from channel.medium.tracks import Tracks, truth_row

MS = 1_000_000


def tracks(**samples_by_node):
    """Tracks of nodes from (time in ms, position) each; a node with no time is placed."""
    out = Tracks(tuple(samples_by_node), max_age_ns=1000 * MS)
    for i, samples in enumerate(samples_by_node.values()):
        for time_ms, position in samples:
            if time_ms is None:
                out.place(i, truth_row(position, None))
            else:
                out.observe(i, time_ms * MS, truth_row(position, None))
    return out


STRAIGHT = [(0, (0.0, 0.0, -40.0)), (50, (1.0, -0.5, -40.0)), (100, (1.0, 0.5, -40.25))]


@pytest.mark.parametrize(
    ("at_ms", "velocity_ned_mps"),
    [
        (-10, (0, 0, 0)),
        (0, (0, 0, 0)),
        (1, (20, -10, 0)),
        (50, (20, -10, 0)),
        (51, (0, 20, -5)),
        (100, (0, 20, -5)),
        (101, (0, 0, 0)),
    ],
)
def test_velocity_is_the_slope_of_the_way_between_two_samples(at_ms, velocity_ned_mps):
    velocity = tracks(a=STRAIGHT).velocities_at(at_ms * MS)
    assert velocity[:, 0] == pytest.approx(velocity_ned_mps, abs=1e-9)


def test_each_node_has_the_velocity_of_its_own_samples():
    other = [(10, (0.0, 0.0, -5.0)), (90, (0.0, 4.0, -5.0))]
    still = [(None, (7.0, 7.0, 0.0))]
    together = tracks(a=STRAIGHT, b=other, c=still)
    north, east, down = together.velocities_at(70 * MS)
    assert north == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)
    assert east == pytest.approx([20.0, 50.0, 0.0], abs=1e-9)
    assert down == pytest.approx([-5.0, 0.0, 0.0], abs=1e-9)
    for i, alone in enumerate((tracks(a=STRAIGHT), tracks(a=other), tracks(a=still))):
        for at_ms in (5, 50, 70):
            assert np.array_equal(
                alone.velocities_at(at_ms * MS)[:, 0], together.velocities_at(at_ms * MS)[:, i]
            )


def test_positions_lie_on_the_way_that_the_velocity_follows():
    line = tracks(a=STRAIGHT)
    early, late = line.columns_at(60 * MS, 3)[:, 0], line.columns_at(80 * MS, 3)[:, 0]
    assert (late - early) / 0.02 == pytest.approx(line.velocities_at(80 * MS)[:, 0], abs=1e-9)
