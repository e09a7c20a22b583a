"""Fields over places: their law, their correlation, and that they have no memory."""

from functools import lru_cache

import numpy as np
import pytest
from scipy.stats import kstest

from channel.draws import Draws
from channel.fading.link_words import LinkWords
from channel.fading.place_field import PlaceField, SharedField
from channel.fading.shadowing import CorrelatedShadowing
from channel.fading.terms import LastingShadowing, LineOfSight
from channel.fading.waves import link_places

NODES = [f"n{i}" for i in range(30)]
TX, RX = np.triu_indices(len(NODES), 1)
NOW = np.zeros((), dtype=np.int64)
HERE, THERE = np.array([120.0, -40.0, -40.0]), np.array([500.0, 300.0, -60.0])
SEEDS = range(100)


def places(seed, tx_ned_m=HERE, rx_ned_m=THERE, tx=TX, rx=RX):
    words = LinkWords(seed, NODES, "fields")
    return link_places(words, np.asarray(tx), np.asarray(rx), tx_ned_m, rx_ned_m, NOW)


def way_m(tx_ned_m, rx_ned_m):
    """Distances for all links."""
    return np.linalg.norm(np.subtract(rx_ned_m, tx_ned_m)) * np.ones(TX.size)


THREE = LinkWords(1, ("a", "b", "c"), "fields")


@lru_cache
def shared_fields():
    return [SharedField(Draws(seed), 50.0, "test") for seed in range(300)]


def shared_field(tx_ned_m, rx_ned_m, tx=0, rx=1):
    """Values of the field that all pairs share, by seed."""
    here = link_places(THREE, np.array([tx]), np.array([rx]), np.asarray(tx_ned_m), np.asarray(rx_ned_m), NOW)
    way = way_m(tx_ned_m, rx_ned_m)[:1]
    return np.array([field.standard_normal(here, way)[0] for field in shared_fields()])


def fields(tx_move_m, rx_move_m):
    """Values of many independent fields, with the ends moved by so much, one column for each seed."""
    return np.stack(
        [
            PlaceField(Draws(seed), 50.0, "test").standard_normal(
                places(seed, HERE + tx_move_m, THERE + rx_move_m)
            )
            for seed in SEEDS
        ],
        axis=1,
    )


STILL = np.zeros(3)
AT_FIRST = fields(STILL, STILL)


def within(products, theory):
    """Whether the mean of products lies in its interval of 99.9 %; the links of a seed share their waves."""
    by_seed = products.mean(axis=0)
    return abs(by_seed.mean() - theory) < 3.4 * by_seed.std(ddof=1) / np.sqrt(by_seed.size)


def test_the_law_is_normal():
    one_per_seed = AT_FIRST[::30].ravel()
    assert kstest(one_per_seed, "norm").pvalue > 1e-3
    assert within(AT_FIRST**2, 1.0)
    assert within(AT_FIRST**4, 3.0)


@pytest.mark.parametrize("way", [(1.0, 0.0, 0.0), (0.6, 0.8, 0.0), (0.0, 0.0, -1.0)])
@pytest.mark.parametrize("distance_m", [5.0, 25.0, 50.0, 100.0])
def test_the_autocorrelation_is_gudmundsons(way, distance_m):
    moved = fields(STILL, distance_m * np.array(way))
    assert within(AT_FIRST * moved, np.exp(-distance_m / 50.0))


def test_both_ends_decorrelate():
    moved = fields(np.array([20.0, 0.0, 0.0]), np.array([0.0, -30.0, 0.0]))
    assert within(AT_FIRST * moved, np.exp(-50.0 / 50.0))


def test_two_pairs_have_nothing_in_common():
    assert within(AT_FIRST[:-1] * AT_FIRST[1:], 0.0)


def test_a_field_is_reciprocal_and_has_no_memory():
    field = PlaceField(Draws(1), 50.0, "test")
    out = field.standard_normal(places(1))
    back = field.standard_normal(places(1, THERE, HERE, RX, TX))
    assert np.array_equal(out, back)
    alone = [
        PlaceField(Draws(1), 50.0, "test").standard_normal(places(1, tx=TX[k : k + 1], rx=RX[k : k + 1]))[0]
        for k in (7, 0, 300)
    ]
    assert alone == out[[7, 0, 300]].tolist()


def test_two_pairs_at_the_same_places_share_one_field_in_both_directions():
    here = shared_field(HERE, THERE)
    assert np.array_equal(here, shared_field(HERE, THERE, 0, 2))
    back = shared_field(THERE, HERE, 1, 0)
    assert np.array_equal(here, back)
    assert np.all(
        np.abs(here - shared_field(THERE, HERE)) < 0.02
    )  # but for the steps of the table of cosines


@pytest.mark.parametrize("apart_m", [1.0, 10.0, 50.0, 150.0])
def test_ends_side_by_side_find_the_same_and_farther_ones_less(apart_m):
    """Gudmundson's law over both ends: exp(-(s1 + s2) / 50 m); one metre apart it is 0.98."""
    beside = THERE + np.array([0.6, -0.8, 0.0]) * apart_m
    products = (shared_field(HERE, THERE) * shared_field(HERE, beside))[np.newaxis]
    assert within(products, np.exp(-apart_m / 50.0))
    both = (shared_field(HERE, THERE) * shared_field(np.add(HERE, (0.0, 0.0, 7.0)), beside))[np.newaxis]
    assert within(both, np.exp(-(apart_m + 7.0) / 50.0))


@pytest.mark.parametrize("way", [(1.0, 0.0, 0.0), (20.0, 10.0, 0.0), (900.0, 300.0, 20.0)])
def test_the_shared_field_is_normal_near_and_far(way):
    z = shared_field(HERE, np.add(HERE, way))
    assert kstest(z, "norm").pvalue > 1e-3
    assert within((z**2)[np.newaxis], 1.0)
    assert within((z**4)[np.newaxis], 3.0)


def test_far_places_and_small_steps_count():
    """At 100 km from the origin a step of 1 mm still moves the field by as much as near it."""
    field = PlaceField(Draws(1), 1.0, "test")
    steps = [
        field.standard_normal(places(1, HERE + move)) - field.standard_normal(places(1, HERE + far))
        for far in ((0.0, 0.0, 0.0), (100_000.0, 0.0, 0.0))
        for move in (np.add(far, (0.001, 0.0, 0.0)),)
    ]
    near, far = (float(np.sqrt(np.mean(step**2))) for step in steps)
    assert far == pytest.approx(near, rel=0.2)
    assert near > 0.0


def shadows(shared, tx_ned_m, rx_ned_m, tx, rx):
    model = CorrelatedShadowing(sigma_db=4.0, decorrelation_m=50.0, shared_ends=shared)
    distance_m = np.linalg.norm(rx_ned_m - tx_ned_m, axis=-1) * np.ones(len(tx))
    return np.stack(
        [
            LastingShadowing(model, Draws(seed)).standard_normal(
                places(seed, tx_ned_m, rx_ned_m, tx, rx), distance_m
            )
            for seed in range(400)
        ],
        axis=1,
    )


SPOTS = np.array([[0.0, 0.0, -40.0], [800.0, 0.0, -40.0], [0.0, 900.0, -40.0], [700.0, 950.0, -40.0]])


@pytest.mark.slow
@pytest.mark.parametrize("shared", [0.0, pytest.param(0.3, marks=pytest.mark.long), 0.5])
def test_links_that_share_an_end_are_correlated_by_as_much_as_asked_for(shared):
    tx, rx = np.array([0, 0, 1, 2]), np.array([1, 2, 2, 3])
    one, other, third, fourth = shadows(shared, SPOTS[tx], SPOTS[rx], tx, rx)
    assert within((one * other)[np.newaxis], shared)
    assert within((one * third)[np.newaxis], shared)
    assert within((one * fourth)[np.newaxis], 0.0)
    assert within((one * one)[np.newaxis], 1.0)


def test_ends_near_each_other_do_not_add_to_the_spread():
    near = shadows(0.5, SPOTS[:1], np.add(SPOTS[:1], (10.0, 0.0, 0.0)), np.array([0]), np.array([1]))
    assert within(near**2, 1.0)


def test_the_line_of_sight_lasts_over_its_way():
    """Both states as likely: the same at two places with probability 1/2 + arcsin(rho) / pi."""
    moved_m = np.array([30.0, 0.0, 0.0])
    seen = [
        [
            LineOfSight(Draws(seed), 60.0).standard_normal(places(seed, HERE, there), way_m(HERE, there))
            < 0.0
            for seed in range(100)
        ]
        for there in (THERE, THERE + moved_m)
    ]
    now, then = np.array(seen).transpose(0, 2, 1)
    assert within(now, 0.5)
    assert within(now == then, 0.5 + np.arcsin(np.exp(-30.0 / 60.0)) / np.pi)
