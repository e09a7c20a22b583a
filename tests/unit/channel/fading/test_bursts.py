"""The states of Gilbert and Elliott against the process that they come from."""

import numpy as np
import pytest
from pydantic import ValidationError

from channel.fading.bursts import GilbertElliott
from channel.fading.link_words import LinkWords

NODES = [f"n{i}" for i in range(50)]
TX, RX = np.nonzero(~np.eye(len(NODES), dtype=bool))
WORDS = LinkWords(4, NODES, "bursts").of_direction(TX, RX)


def bad_at(model, times_ns):
    """States of all links, shape (times, links)."""
    return np.array([model.is_bad(WORDS, np.full(len(TX), time_ns)) for time_ns in times_ns])


@pytest.mark.parametrize(("good_s", "bad_s"), [(0.9, 0.1), (2.0, 0.05), (0.3, 0.3)])
def test_the_share_of_the_bad_state(good_s, bad_s):
    model = GilbertElliott(mean_good_s=good_s, mean_bad_s=bad_s)
    share = bad_s / (good_s + bad_s)
    at_once = bad_at(model, [123_456_789])[0]
    assert abs(at_once.mean() - share) < 3.29 * np.sqrt(share * (1.0 - share) / len(TX))


def test_a_state_lasts_as_the_chain_says():
    """P(bad at t + s | bad at t) = pi + (1 - pi) exp(-(1 / good + 1 / bad) s) for a chain of two states."""
    model = GilbertElliott(mean_good_s=0.9, mean_bad_s=0.1)
    start_ns = 7_000_000_000
    lags_s = np.array([0.01, 0.05, 0.1, 0.3, 1.0])
    before, *after = bad_at(model, [start_ns, *(start_ns + (lags_s * 1e9).astype(int))])
    for lag_s, states in zip(lags_s, after, strict=True):
        stays = 0.1 + 0.9 * np.exp(-lag_s / 0.09)
        assert abs(states[before].mean() - stays) < 3.29 * np.sqrt(stays * (1 - stays) / before.sum())


def test_sojourns_have_their_mean_length():
    model = GilbertElliott(mean_good_s=0.9, mean_bad_s=0.1)
    step_s = 0.004
    states = bad_at(model, [round(k * step_s * 1e9) for k in range(400)])
    starts = np.count_nonzero(states[1:] & ~states[:-1])
    seen = 0.1 + 0.5 * step_s  # sojourns shorter than a step are missed, those that are seen count as longer
    assert np.count_nonzero(states) * step_s / starts == pytest.approx(seen, rel=0.05)


def test_an_instant_can_be_asked_alone_and_in_any_order():
    model = GilbertElliott(mean_good_s=0.5, mean_bad_s=0.5)
    times = np.arange(len(TX)) * 10_000_019 - 10**9
    together = model.is_bad(WORDS, times)
    for k in (1700, 3, 0):
        assert model.is_bad(WORDS[k : k + 1], times[k : k + 1])[0] == together[k]


def test_losses_follow_the_state():
    model = GilbertElliott(mean_good_s=0.5, mean_bad_s=0.5, loss_good=0.25, loss_bad=0.75)
    times = np.full(len(TX), 5)
    assert np.array_equal(model.loss_at(WORDS, times) == 0.75, model.is_bad(WORDS, times))
    assert model.mean_loss == pytest.approx(0.5)


def test_durations_of_which_no_instant_can_be_counted_are_refused():
    """Shorter ones never came to an end; longer ones were no number of nanoseconds."""
    for mean_s in (1e-12, 1e10):
        with pytest.raises(ValidationError, match="mean_good_s"):
            GilbertElliott(mean_good_s=mean_s, mean_bad_s=1.0)
        with pytest.raises(ValidationError, match="mean_bad_s"):
            GilbertElliott(mean_good_s=1.0, mean_bad_s=mean_s)


@pytest.mark.parametrize("mean_s", [1e-6, 1e9])
def test_the_shortest_and_the_longest_states(mean_s):
    share = bad_at(GilbertElliott(mean_good_s=mean_s, mean_bad_s=mean_s), [10**15])[0].mean()
    assert abs(share - 0.5) < 3.29 * np.sqrt(0.25 / len(TX))
