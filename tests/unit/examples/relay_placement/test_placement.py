"""Where the relay goes, against closed forms, sums over all outcomes and a search by hand."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from placement import Delivery, Floats, Links, best, delivery_of, direct, grid, links_of, relayed

from channel import Radio, load_radio

GROUND = np.array([0.0, 0.0, -3.0])
chances = st.floats(0.0, 1.0)


def bell(reach_m: float, range_m: float = 780.0) -> Delivery:
    """exp(-(d / reach)^2) over the ground, nothing beyond a range: products of it have their top in closed form."""

    def delivery(tx_ned_m: Floats, rx_ned_m: Floats) -> Floats:
        away_m = np.linalg.norm((tx_ned_m - rx_ned_m)[..., :2], axis=-1)
        return np.where(away_m < range_m, np.exp(-((away_m / reach_m) ** 2)), 0.0)

    return delivery


def certain(chance: float) -> Delivery:
    return lambda tx_ned_m, rx_ned_m: np.full(
        np.broadcast_shapes(tx_ned_m.shape, rx_ned_m.shape)[:-1], chance
    )


@given(chances, chances, chances)
def test_end_to_end_is_the_sum_over_all_outcomes_of_the_hops(up: float, down: float, across: float) -> None:
    """Each of direct hop, first hop and second hop is lost or not: eight outcomes each way."""

    def by_outcomes(hop: float) -> float:
        total = 0.0
        for straight, first, second in product((True, False), repeat=3):
            chance = math.prod(
                p if arrived else 1.0 - p for p, arrived in ((hop, straight), (hop, first), (across, second))
            )
            total += chance if straight or (first and second) else 0.0
        return total

    links = Links(certain(up), certain(down), certain(across))
    found = relayed(links, GROUND, GROUND + 1.0, GROUND + 2.0)
    assert found.up == pytest.approx(by_outcomes(up), abs=1e-12)
    assert found.down == pytest.approx(by_outcomes(down), abs=1e-12)
    assert found.both == pytest.approx(by_outcomes(up) * by_outcomes(down), abs=1e-12)


@pytest.mark.parametrize(("reach_up_m", "reach_down_m"), [(300.0, 300.0), (300.0, 150.0), (200.0, 400.0)])
def test_the_best_place_divides_the_way_as_the_reaches_say(reach_up_m: float, reach_down_m: float) -> None:
    """The exponent a x^2 + b (d - x)^2 is least at x = b d / (a + b); the UA is out of direct range."""
    reach_m, way_m = 300.0, 800.0
    links = Links(bell(reach_up_m), bell(reach_down_m), bell(reach_m))
    ua = np.array([0.0, way_m, -40.0])
    candidates = grid([-100, 100], [0, way_m], 10.0, 60.0)
    found = candidates[best(relayed(links, GROUND, ua, candidates).both, candidates, ua, slack=0.0)]
    a, b = reach_up_m**-2 + reach_down_m**-2, 2.0 * reach_m**-2
    assert direct(links, GROUND, ua).both == 0.0
    assert found == pytest.approx([0.0, b * way_m / (a + b), -60.0], abs=5.0 + 1e-6)


@given(
    st.lists(st.integers(0, 20).map(lambda part: part / 20.0), min_size=4, max_size=4),
    st.floats(-50.0, 150.0),
    st.floats(-50.0, 150.0),
    st.sampled_from([0.0, 0.07, 1.0]),
)
def test_of_places_as_good_as_the_best_it_is_the_nearest(
    values: list[float], north_m: float, east_m: float, slack: float
) -> None:
    candidates = grid([0, 100], [0, 100], 100.0, 60.0)
    here = np.array([north_m, east_m, -60.0])
    found = best(np.array(values), candidates, here, slack)
    top = max(values)
    nearest_m, chosen_m = math.inf, math.dist(candidates[found], here)
    for value, place in zip(values, candidates.tolist(), strict=True):
        if value >= top - slack:
            nearest_m = min(nearest_m, math.dist(place, here))
    assert values[found] >= top - slack
    assert chosen_m == pytest.approx(nearest_m)


def test_the_grid_has_both_ends() -> None:
    places = grid([0, 40], [-20, 20], 20.0, 60.0)
    expected = [(n, e, -60.0) for n, e in product((0.0, 20.0, 40.0), (-20.0, 0.0, 20.0))]
    assert list(map(tuple, places.tolist())) == expected


def test_a_delivery_is_that_of_the_quadrature_for_each_direction() -> None:
    """`Radio.delivery` integrates for each link; here a table is looked up, of the radios of both ends."""
    ua = Radio(load_radio("wifi-5.8"))
    ground = Radio(load_radio("wifi-5.8", {"noise": {"noise_figure_db": 12}}))
    links = links_of(ground, ua, 24)
    places = np.array([[120.0, 50.0, -60.0], [300.0, -90.0, -60.0], [520.0, 200.0, -40.0]])
    for found, transmitter, receiver in (
        (links.up(GROUND, places), ground, ua),
        (links.down(places, GROUND), ua, ground),
        (links.across(places, GROUND), ua, ua),
    ):
        radio = transmitter.towards(receiver)
        expected = radio.delivery(
            position_tx_ned_m=GROUND if transmitter is ground else places,
            position_rx_ned_m=places if transmitter is ground else GROUND,
            length_bytes=24,
        )
        assert found == pytest.approx(expected.probability, abs=1e-4)
    assert np.all(links.up(GROUND, places) > links.down(places, GROUND) + 1e-4)


def test_beyond_the_range_nothing_arrives() -> None:
    disk = Radio(load_radio("disk"))
    places = GROUND + np.array([[399.0, 0.0, 0.0], [401.0, 0.0, 0.0]])
    assert delivery_of(disk, disk, 24)(GROUND, places).tolist() == [1.0, 0.0]
