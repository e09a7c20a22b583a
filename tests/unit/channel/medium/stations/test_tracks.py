"""Positions and velocities of tracks between truth samples."""

import numpy as np
import pytest

from channel.medium.stations.tracks import KEPT_SAMPLES, Tracks, truth_rows

MS = 1_000_000


def tracks(**samples_by_node):
    """Tracks of nodes from (time in ms, position) each; a node with no time is placed."""
    out = Tracks(len(samples_by_node), max_age_ns=1000 * MS)
    for i, samples in enumerate(samples_by_node.values()):
        for time_ms, position in samples:
            if time_ms is None:
                out.place(i, truth_rows(position, None))
            else:
                out.observe(np.array([i]), time_ms * MS, truth_rows([position], None))
    return out


def velocities(tracks, *at_ms):
    return tracks.at(np.array(at_ms) * MS, velocity=True).velocity_ned_mps


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
    velocity = velocities(tracks(a=STRAIGHT), at_ms)
    assert velocity[:, 0] == pytest.approx(velocity_ned_mps, abs=1e-9)


def test_each_node_has_the_velocity_of_its_own_samples():
    other = [(10, (0.0, 0.0, -5.0)), (90, (0.0, 4.0, -5.0))]
    still = [(None, (7.0, 7.0, 0.0))]
    together = tracks(a=STRAIGHT, b=other, c=still)
    north, east, down = velocities(together, 70)
    assert north == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)
    assert east == pytest.approx([20.0, 50.0, 0.0], abs=1e-9)
    assert down == pytest.approx([-5.0, 0.0, 0.0], abs=1e-9)
    for i, alone in enumerate((tracks(a=STRAIGHT), tracks(a=other), tracks(a=still))):
        for at_ms in (5, 50, 70):
            assert np.array_equal(velocities(alone, at_ms)[:, 0], velocities(together, at_ms)[:, i])


def test_many_instants_at_once_are_as_one_by_one_whatever_lies_between():
    rng = np.random.Generator(np.random.PCG64(3))
    samples = {
        name: [(int(at), rng.normal(size=3)) for at in np.cumsum(rng.integers(1, 40, size=count))]
        for name, count in (("a", 60), ("b", 3), ("c", 9), ("d", 1))
    }
    all_tracks = tracks(**samples, e=[])
    at_ms = np.arange(-20, 1300, 7)
    position = all_tracks.at(at_ms * MS).position_ned_m.reshape(3, -1, 5)
    for node, rows in enumerate(samples.values()):
        times, places = (np.array(column) for column in zip(*rows, strict=True))
        for axis in range(3):
            expected = np.interp(at_ms, times, places[:, axis])
            assert position[axis, :, node] == pytest.approx(expected, abs=1e-12)
    assert not position[:, :, 4].any()
    assert all_tracks.known.tolist() == [True, True, True, True, False]
    for i in (0, 40, 100, 188):
        assert np.array_equal(all_tracks.at(at_ms[i : i + 1] * MS).position_ned_m, position[:, i])


def test_old_samples_go_and_the_newest_stay():
    line = Tracks(2, max_age_ns=1000 * MS)
    for tick in range(5000):
        line.observe(np.array([0]), tick * MS, truth_rows([(float(tick), 0.0, 0.0)], None))
        if tick < 10:
            line.observe(np.array([1]), tick * MS, truth_rows([(0.0, 2.0 * tick, 0.0)], None))
    north, east, _ = line.at(np.array([0, 4, 4500, 9000]) * MS).position_ned_m.reshape(3, 4, 2)
    assert north[:, 0].tolist() == [north[0, 0], north[0, 0], 4500.0, 4999.0]
    assert 5000 - 2 * KEPT_SAMPLES <= north[0, 0] <= 5000 - KEPT_SAMPLES
    assert east[:, 1].tolist() == [0.0, 8.0, 18.0, 18.0]


def test_a_turned_sign_of_a_quaternion_is_the_same_attitude():
    attitude = np.array([0.6, 0.0, 0.8, 0.0])
    line = Tracks(1, max_age_ns=1000 * MS)
    for tick, sign in enumerate((1.0, -1.0, -1.0)):
        line.observe(np.array([0]), tick * MS, truth_rows([(0.0, 0.0, 0.0)], [sign * attitude]))
    found = line.at(np.array([MS // 2, 3 * MS // 2]), attitude=True).attitude_wxyz
    assert pytest.approx(np.array([attitude, attitude])) == found.T


def test_positions_lie_on_the_way_that_the_velocity_follows():
    line = tracks(a=STRAIGHT)
    early, late = line.at(np.array([60, 80]) * MS).position_ned_m.T
    assert (late - early) / 0.02 == pytest.approx(velocities(line, 80)[:, 0], abs=1e-9)
