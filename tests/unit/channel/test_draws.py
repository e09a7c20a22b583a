import numpy as np
import pytest

from channel.checks import ChannelInputError
from channel.draws import Draws, Purpose, stream_key, uniform_from_words


def test_scalar_and_block_draw_the_same_numbers():
    receivers = ["1", "2", "gcs"]
    for purpose in Purpose:
        vector = [Draws(7).uniforms(purpose, "0", receivers, seq) for seq in (0, 1, 255, 256, 1000)]
        scalar = [
            [Draws(7).uniform(purpose, "0", rx, seq) for rx in receivers] for seq in (0, 1, 255, 256, 1000)
        ]
        assert np.array_equal(vector, scalar)


def test_counter_is_the_sequence_number_of_numpys_philox():
    key = stream_key(3, "a", "b", "packet")
    expected = np.random.Philox(key=key, counter=[41, 0, 0, 0]).random_raw(4)
    assert Draws(3).words(("a", "b", "packet"), 42, 1)[0].tolist() == expected.tolist()
    before_zero = np.random.Philox(key=key, counter=[2**64 - 1] * 4).random_raw(4)
    assert Draws(3).words(("a", "b", "packet"), 0, 1)[0].tolist() == before_zero.tolist()


def test_links_directions_purposes_and_seeds_differ():
    def first(seed, purpose, tx, rx):
        return Draws(seed).uniform(purpose, tx, rx, 0)

    numbers = {
        first(s, p, a, b)
        for s in (1, 2, -1)
        for p in Purpose
        for a, b in (("0", "1"), ("1", "0"), ("01", ""))
    }
    assert len(numbers) == 3 * len(Purpose) * 3


def test_keys_are_stable_between_processes_and_versions():
    assert stream_key(1, "0", "1", "packet").tolist() == [13079243951288749610, 1376090398880769227]


def test_uniforms_never_reach_the_ends():
    ends = uniform_from_words(np.array([0, 2**64 - 1], dtype=np.uint64))
    assert 0.0 < ends[0] < 1e-15
    assert 1.0 - 1e-15 < ends[1] < 1.0


def test_uniforms_are_uniform_and_uncorrelated_between_links():
    from scipy.stats import kstest

    a = uniform_from_words(Draws(1).words(("0", "1", "packet"), 0, 20000)[:, 0])
    b = uniform_from_words(Draws(1).words(("1", "0", "packet"), 0, 20000)[:, 0])
    assert kstest(a, "uniform").pvalue > 1e-3
    assert abs(np.corrcoef(a, b)[0, 1]) < 4 / np.sqrt(20000)


def test_negative_sequence_numbers_are_refused():
    with pytest.raises(ChannelInputError, match="seq = -1"):
        Draws(1).uniform(Purpose.ERASURE, "0", "1", -1)
