"""The integral over the shadowing against dense algebra, and against sums over a grid of all shadowings."""

import math

import numpy as np
import pytest

from channel.fit.correlated.field import places_of
from channel.fit.correlated.outcomes import Outcomes
from channel.fit.correlated.propagation import CorrelatedLikelihood, Law, Log, Readings
from channel.phy.error_model import Band, UncodedAwgn

BAND = Band(20e6, 24e6)
BITS = 320


def per(snr_db):
    ebn0 = 10.0 ** (np.asarray(snr_db, dtype=float) / 10.0) * 20.0 / 24.0
    ber = 0.5 * np.vectorize(math.erfc)(np.sqrt(ebn0))
    return -np.expm1(BITS * np.log1p(-ber))


def log_of(distance_m, delivered, design, readings=None, step_variance=0.0025):
    places = places_of(distance_m, np.zeros(distance_m.size, dtype=np.intp))
    count = places.gap_m.size + 1
    none = Readings(np.zeros(count), np.zeros(count), 0.0, step_variance)
    outcomes = Outcomes(UncodedAwgn(), BAND, [40.0], np.zeros(delivered.size, dtype=np.intp), delivered)
    doubtful = np.arange(delivered.size)
    ones = np.ones(delivered.size)
    return Log(
        places, np.full(count, -80.0), design, readings or none, places.of_packet[doubtful], ones, outcomes, 0
    )


def test_readings_alone_give_the_dense_restricted_likelihood():
    rng = np.random.Generator(np.random.PCG64(1))
    at = 50.0 + 0.02 * np.sort(rng.choice(3900, 40, replace=False))
    design = np.stack((-10.0 * np.log10(at), np.ones(40)), axis=-1)
    reading = -80.0 + rng.normal(0.0, 6.0, 40)
    readings = Readings(np.ones(40), reading, 0.0, 0.0025)
    empty = np.zeros(0, dtype=bool)
    base = log_of(at, np.ones(40, dtype=bool), design, readings)
    outcomes = Outcomes(UncodedAwgn(), BAND, [40.0], np.zeros(0, dtype=np.intp), empty)
    place, packets = np.zeros(0, dtype=np.intp), np.zeros(0)
    log = Log(base.places, base.fixed_dbm, design, readings, place, packets, outcomes, 0)
    law = Law(5.0, 30.0, 0.7, -100.0, 0.0)
    found = CorrelatedLikelihood(log).integral(law)

    covariance = 25.0 * np.exp(-np.abs(at[:, np.newaxis] - at) / 30.0) + 0.49 * np.eye(40)
    inverse = np.linalg.inv(covariance)
    bend = design.T @ inverse @ design
    line = np.linalg.solve(bend, design.T @ inverse @ (reading + 80.0))
    left = reading + 80.0 - design @ line
    value = -0.5 * (left @ inverse @ left + np.linalg.slogdet(covariance)[1] + np.linalg.slogdet(bend)[1])
    assert found.line == pytest.approx(line, rel=1e-4)
    assert found.covariance == pytest.approx(np.linalg.inv(bend), rel=1e-4)
    assert found.value == pytest.approx(value, abs=1e-3)


@pytest.mark.parametrize("base_loss", [0.0, 0.1])
@pytest.mark.parametrize("delivered", [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)])
def test_arrivals_and_losses_give_the_sum_over_all_shadowings(delivered, base_loss):
    at, arrived = np.array([100.0, 112.0, 150.0]), np.array(delivered, dtype=bool)
    law = Law(6.0, 25.0, 0.5, -86.0, base_loss)
    log = log_of(at, arrived, np.zeros((3, 0)))
    value = CorrelatedLikelihood(log).integral(law).value

    grid = np.linspace(-30.0, 30.0, 121)
    kept = (1.0 - base_loss) * (1.0 - per(-80.0 + grid + 86.0))
    chance = [kept if ok else 1.0 - kept for ok in arrived]
    covariance = 36.0 * np.exp(-np.abs(at[:, np.newaxis] - at) / 25.0)
    inverse = np.linalg.inv(covariance)
    s = np.stack(np.meshgrid(grid, grid, grid, indexing="ij"), axis=-1)
    density = np.exp(-0.5 * np.einsum("...i,ij,...j->...", s, inverse, s))
    density /= density.sum()
    total = np.einsum("ijk,i,j,k->", density, *chance)
    assert value == pytest.approx(math.log(total), abs=0.03)


def test_a_long_stretch_of_losses_costs_what_it_costs():
    """The chance that shadowing stays low over 20 places: by drawing it, where Laplace's approximation sees none."""
    at = np.linspace(100.0, 195.0, 20)
    law = Law(6.0, 25.0, 0.5, -86.0, 0.0)
    value = CorrelatedLikelihood(log_of(at, np.zeros(20, dtype=bool), np.zeros((20, 0)))).integral(law).value
    rng = np.random.Generator(np.random.PCG64(2))
    covariance = 36.0 * np.exp(-np.abs(at[:, np.newaxis] - at) / 25.0)
    drawn = rng.standard_normal((40_000, 20)) @ np.linalg.cholesky(covariance).T
    grid = np.linspace(-60.0, 60.0, 2401)
    lost = np.interp(drawn, grid, per(-80.0 + grid + 86.0))
    assert value == pytest.approx(math.log(np.mean(np.prod(lost, axis=1))), abs=0.2)
