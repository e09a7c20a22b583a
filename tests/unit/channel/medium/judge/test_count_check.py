"""How likely a count of losses is, against the exact law of independent trials with chances of their own."""

import numpy as np
import pytest

from channel.medium.judge.check import count_check

FEW_RARE = np.full(116, 0.05)
FEW_CERTAIN = np.full(60, 0.9)
MANY = np.full(3000, 0.3)
MIXED = np.concatenate((np.full(500, 0.002), np.full(20, 0.6), np.linspace(0.0, 1.0, 40)))


def exact_law(chances):
    law = np.array([1.0])
    for chance in chances:
        law = np.convolve(law, [1.0 - chance, chance])
    return law


@pytest.mark.parametrize(
    "chances", [FEW_RARE, FEW_CERTAIN, MANY, MIXED], ids=["rare", "near 1", "many", "mixed"]
)
def test_the_chance_of_a_count_is_that_of_the_exact_law(chances):
    law, mean, spread = exact_law(chances), chances.sum(), chances * (1.0 - chances)
    moments = spread.sum(), (spread * (1.0 - 2.0 * chances)).sum()
    for count in np.flatnonzero((law > 1e-7) & (abs(np.arange(law.size) - mean) > moments[0] ** 0.5)):
        least = min(law[: count + 1].sum(), law[count:].sum())
        if least > 1e-5:  # below, whether it is a tenth of that or a hundredth changes nothing
            said = count_check("losses", chances.size, count - mean, moments, "any", 1.0).chance
            assert 0.6 < said / (2.0 * least) < 1.9, count


def test_what_comes_once_in_a_thousand_times_is_not_called_wrong():
    """By the normal law it would: 8.9e-5."""
    moments = 116 * 0.05 * 0.95, 116 * 0.05 * 0.95 * 0.9
    check = count_check("base loss", 116, 15 - 116 * 0.05, moments, "any", 1.0)
    assert check.found == pytest.approx(3.92, abs=0.01)
    assert check.chance == pytest.approx(2 * 0.0007, rel=0.3)
    assert check.passed
    assert not count_check("base loss", 116, 18 - 116 * 0.05, moments, "any", 1.0).passed
