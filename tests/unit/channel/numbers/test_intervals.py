import numpy as np
import pytest
from scipy.stats import binom, binomtest

from channel.checks import ChannelInputError
from channel.numbers.intervals import binomial_interval, proportion_interval


@pytest.mark.parametrize("n", [1, 7, 50, 1234])
@pytest.mark.parametrize("p", [0.0, 1e-6, 0.03, 0.5, 0.999, 1.0])
def test_binomial_interval_is_that_of_the_quantiles(n, p):
    low, high = binomial_interval(n, p)
    expected = np.maximum(binom.ppf([0.005, 0.995], n, p), 0.0) / n
    assert [float(low), float(high)] == pytest.approx(expected.tolist(), abs=1e-12)


@pytest.mark.parametrize(("k", "n"), [(0, 10), (10, 10), (3, 10), (450, 500)])
def test_proportion_interval_is_clopper_pearson(k, n):
    expected = binomtest(k, n).proportion_ci(0.99, "exact")
    low, high = proportion_interval(k, n)
    assert [float(low), float(high)] == pytest.approx([expected.low, expected.high], abs=1e-9)


def test_more_successes_than_trials():
    with pytest.raises(ChannelInputError, match="successes"):
        proportion_interval(3, 2)
