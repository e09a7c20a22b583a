"""Correlated fading against the theory of Clarke, Jakes, Rice, and Akki and Haber."""

import numpy as np
import pytest
from scipy.special import j0
from scipy.stats import kstest

from channel.draws import Draws
from channel.fading.laws import Nakagami, Rayleigh, Rician
from channel.fading.link_words import LinkWords
from channel.fading.scatter import Scatter
from channel.fading.terms import LastingFading
from channel.fading.waves import link_places

LIGHT_MPS = 299_792_458.0
CARRIER_HZ = 2.4e9
WAVELENGTH_M = LIGHT_MPS / CARRIER_HZ
NODES = [f"n{i}" for i in range(60)]
TX, RX = np.triu_indices(len(NODES), 1)
ORIGIN, FAR = np.array([0.0, 0.0, -40.0]), np.array([0.0, 5e4, -40.0])
NORTH, EAST, DOWN = np.eye(3)


def scatter(seed, tx_ned_m, rx_ned_m, time_s=0.0, scattering="ring", doppler_hz=0.0, tx=TX, rx=RX):
    words = LinkWords(seed, NODES, "fields")
    now = np.asarray(np.round(np.asarray(time_s) * 1e9), dtype=np.int64)
    links = link_places(words, np.asarray(tx), np.asarray(rx), tx_ned_m, rx_ned_m, now)
    return Scatter(Draws(seed), CARRIER_HZ, doppler_hz, scattering).field(links)


def correlation_is(theory, **moved):
    """Mean of h(0) h*(moved) over many seeds and links, against theory, within 99.9 %."""
    scattering = moved.pop("scattering", "ring")
    doppler_hz = moved.pop("doppler_hz", 0.0)
    there = {"tx_ned_m": ORIGIN, "rx_ned_m": FAR} | moved
    means = []
    for seed in range(40):
        first = scatter(seed, ORIGIN, FAR, scattering=scattering, doppler_hz=doppler_hz)
        then = scatter(seed, **there, scattering=scattering, doppler_hz=doppler_hz)
        means.append(np.mean(first * then.conj()))
    means = np.array(means)
    error = 3.46 / np.sqrt(len(means))
    assert abs(means.real.mean() - theory) < error * means.real.std(ddof=1) + 1e-3
    assert abs(means.imag.mean()) < error * means.imag.std(ddof=1) + 1e-3


@pytest.mark.parametrize("waves", [0.05, 0.2, 0.3827, 0.6, 1.0, 1.9, 4.3])
def test_the_autocorrelation_along_a_level_track_is_j0(waves):
    correlation_is(j0(2 * np.pi * waves), rx_ned_m=FAR + waves * WAVELENGTH_M * (0.6 * NORTH - 0.8 * EAST))


@pytest.mark.parametrize(("one", "other"), [(0.2, 0.3), (0.5, 0.5), (1.4, 0.3)])
def test_two_ends_that_move_multiply(one, other):
    """Akki & Haber 1986; also in formation: what reflects stands still."""
    correlation_is(
        j0(2 * np.pi * one) * j0(2 * np.pi * other),
        tx_ned_m=ORIGIN + one * WAVELENGTH_M * NORTH,
        rx_ned_m=FAR + other * WAVELENGTH_M * NORTH,
    )


@pytest.mark.parametrize("way", [NORTH, DOWN])
def test_waves_from_the_whole_sphere_go_as_sinc(way):
    moved = FAR + 0.35 * WAVELENGTH_M * way
    correlation_is(np.sinc(2 * 0.35), rx_ned_m=moved, scattering="sphere")


def test_ends_that_stand_still_see_the_surroundings_move():
    correlation_is(j0(2 * np.pi * 0.18 * 2.0), time_s=2.0, doppler_hz=0.18)
    correlation_is(1.0, time_s=2.0)


def test_one_run_leaves_the_theory_by_what_its_waves_are_too_few():
    """rms of 1 / sqrt(31), 0.18, over the ways of both ends, up to eight wavelengths each; 15 waves have 0.25."""
    rng, off = np.random.default_rng(5), []
    for seed in range(100):
        first, second = rng.uniform(0.0, 8.0, 2)
        turns = rng.uniform(0.0, 2.0 * np.pi, 2)
        one, other = (
            waves * WAVELENGTH_M * (np.cos(turn) * NORTH + np.sin(turn) * EAST)
            for waves, turn in zip((first, second), turns, strict=True)
        )
        here, there = scatter(seed, ORIGIN, FAR), scatter(seed, ORIGIN + one, FAR + other)
        theory = j0(2 * np.pi * first) * j0(2 * np.pi * second)
        off.append(abs(np.mean(here * there.conj()) - theory) ** 2 - 1.0 / len(TX))
    assert 0.12 < np.sqrt(np.mean(off)) < 0.21


def test_the_field_is_circularly_normal():
    field = np.concatenate([scatter(seed, ORIGIN, FAR)[::40] for seed in range(60)])
    assert kstest(np.abs(field) ** 2, "expon").pvalue > 1e-3
    assert kstest(np.angle(field) / (2 * np.pi) + 0.5, "uniform").pvalue > 1e-3
    assert kstest(field.real * np.sqrt(2.0), "norm").pvalue > 1e-3


def test_both_directions_and_any_instant_alone():
    times = np.linspace(0.0, 100.0, len(TX))
    there = FAR + np.linspace(0.0, 3000.0, len(TX))[:, np.newaxis] * NORTH
    together = scatter(3, np.broadcast_to(ORIGIN, there.shape), there, times, doppler_hz=0.2)
    back = scatter(3, there, np.broadcast_to(ORIGIN, there.shape), times, doppler_hz=0.2, tx=RX, rx=TX)
    assert np.array_equal(together, back)
    for k in (1500, 4):
        part = slice(k, k + 1)
        alone = scatter(3, ORIGIN, there[part], times[part], doppler_hz=0.2, tx=TX[part], rx=RX[part])
        assert alone[0] == together[k]


# --- along tracks: level crossings and fade durations ---

SPEED_MPS = 15.0
DOPPLER_HZ = SPEED_MPS / WAVELENGTH_M
STEPS_PER_WAVE = 100
WAVES_LONG = 100


def tracks(model, way, links=60, seed=2):
    """Gains of links along straight tracks, shape (links, instants), each step a hundredth of a Doppler period."""
    fading = LastingFading(model, Draws(seed), CARRIER_HZ)
    words = LinkWords(seed, NODES, "fields")
    steps = np.arange(WAVES_LONG * STEPS_PER_WAVE)
    there = FAR + (steps / STEPS_PER_WAVE * WAVELENGTH_M)[:, np.newaxis] * way
    rows = []
    for tx, rx in zip(TX[:links], RX[:links], strict=True):
        one = np.full(len(steps), tx), np.full(len(steps), rx)
        place = link_places(words, *one, ORIGIN, there, np.zeros((), np.int64))
        distance_m = np.linalg.norm(there - ORIGIN, axis=-1)
        none = np.zeros(len(steps))
        rows.append(fading.gain_db(place, np.zeros(len(steps), np.int64), distance_m, none, np.zeros(())))
    return np.array(rows)


def crossings(gain_db, level_db):
    """Rate of upward crossings in units of the Doppler shift, and mean time below in its periods, per link."""
    below = gain_db < level_db
    rate = np.count_nonzero(below[:, :-1] & ~below[:, 1:], axis=1) / WAVES_LONG
    return rate, below.mean(axis=1)


def close_to(per_link, theory, tolerance=0.0):
    error = 3.46 * per_link.std(ddof=1) / np.sqrt(len(per_link))
    assert abs(per_link.mean() - theory) < error + tolerance * theory, (per_link.mean(), theory, error)
    assert error < 0.25 * theory


@pytest.fixture(scope="module")
def rayleigh():
    return tracks(Rayleigh(coherence="doppler", max_coherence_s=1e4), NORTH)


@pytest.mark.parametrize("level_db", [-15.0, -10.0, -5.0, 0.0, 4.0])
def test_rayleigh_crosses_a_level_as_rice_says(rayleigh, level_db):
    """N = sqrt(2 pi) f_d rho exp(-rho^2); time below 1 - exp(-rho^2) (Rappaport, eq. 5.80 and 5.84)."""
    rho = 10.0 ** (level_db / 20.0)
    rate, below = crossings(rayleigh, level_db)
    close_to(rate, np.sqrt(2.0 * np.pi) * rho * np.exp(-(rho**2)), 0.03)
    close_to(below, -np.expm1(-(rho**2)), 0.02)
    fade = below.sum() / rate.sum()
    assert fade == pytest.approx(np.expm1(rho**2) / (rho * np.sqrt(2.0 * np.pi)), rel=0.12)


@pytest.mark.parametrize("level_db", [-10.0, -3.0, 0.0, 3.0])
def test_rician_across_the_direct_path_crosses_as_rice_says(level_db):
    """The direct path has no Doppler shift (Stueber, Principles of Mobile Communication, eq. 2.101)."""
    from scipy.special import i0

    k, rho = 10.0 ** (6.0 / 10.0), 10.0 ** (level_db / 20.0)
    model = Rician(k_db=6.0, coherence="doppler", max_coherence_s=1e4)
    rate, _ = crossings(tracks(model, NORTH), level_db)
    theory = np.sqrt(2.0 * np.pi * (k + 1.0)) * rho * np.exp(-k - (k + 1.0) * rho**2)
    theory *= i0(2.0 * rho * np.sqrt(k * (k + 1.0)))
    error = 3.46 * rate.std(ddof=1) / np.sqrt(len(rate))
    assert abs(rate.mean() - theory) < error + 0.03 * theory, (rate.mean(), theory, error)


@pytest.mark.parametrize(("way", "shift"), [(EAST, 1.0), (NORTH, 0.0), (0.6 * EAST + 0.8 * NORTH, 0.6)])
def test_the_direct_path_has_its_own_doppler_shift(way, shift):
    """Autocovariance of the power: (2 K cos(w0 t) J0(w t) + J0(w t)^2) / (K + 1)^2, w0 = w cos(angle)."""
    k = 10.0 ** (6.0 / 10.0)
    model = Rician(k_db=6.0, coherence="doppler", max_coherence_s=1e4)
    power = 10.0 ** (np.concatenate([tracks(model, way, 40, seed) for seed in range(4)]) / 10.0)
    for lag in (15, 30, 50, 75):
        x = 2.0 * np.pi * lag / STEPS_PER_WAVE
        theory = (2.0 * k * np.cos(shift * x) * j0(x) + j0(x) ** 2) / (k + 1.0) ** 2
        found = np.mean((power[:, :-lag] - 1.0) * (power[:, lag:] - 1.0), axis=1)
        error = 3.46 * found.std(ddof=1) / np.sqrt(len(found))
        assert abs(found.mean() - theory) < error + 0.01, (lag, found.mean(), theory, error)


def test_nakagami_keeps_its_law_along_tracks():
    from scipy.stats import gamma

    model = Nakagami(m=3.0, coherence="doppler", max_coherence_s=1e4)
    power = 10.0 ** (tracks(model, NORTH, 100)[:, ::2500].ravel() / 10.0)
    assert kstest(power, gamma(3.0, scale=1.0 / 3.0).cdf).pvalue > 1e-3
