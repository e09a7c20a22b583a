import numpy as np
import pytest

from channel.checks import ChannelInputError
from channel.draws import AHEAD_MAX_NODES, Draws, LinkDraws, Purpose, stream_key, uniform_from_words
from channel.numbers.philox import FEW, philox_words

NAMES = ["gcs", "0", "10", "9"]


def draws_of_links(nodes, purposes, tx, seq, packet, rx):
    """The draws of links by arrays, and each by itself."""
    links = LinkDraws(Draws(7), nodes)
    tx, seq, packet, rx = (np.array(each, dtype=np.int64) for each in (tx, seq, packet, rx))
    together = links.uniforms(purposes, (tx, seq), packet, rx)
    ends = [(nodes[tx[p]], nodes[r], int(seq[p])) for p, r in zip(packet, rx, strict=True)]
    return together, [[Draws(7).uniform(purpose, *link) for link in ends] for purpose in purposes]


@pytest.mark.parametrize("crowd", [0, AHEAD_MAX_NODES])
@pytest.mark.parametrize("stream", ["packet", "extra"])
def test_many_links_draw_the_numbers_of_each_ahead_of_need_or_at_once(crowd, stream):
    """Numbers in the same block, across two blocks, far behind and far ahead of the newest."""
    nodes = NAMES + [f"far {i}" for i in range(crowd)]
    purposes = tuple(purpose for purpose in Purpose if purpose.stream == stream)
    tx, seq = [0, 0, 1, 1, 2, 3, 3], [0, 1, 127, 128, 2**62, 5000, 4]
    packet = np.repeat(np.arange(7), 3)
    rx = np.concatenate([[r for r in range(4) if r != t] for t in tx])
    together, alone = draws_of_links(nodes, purposes, tx, seq, packet, rx)
    assert together.tolist() == alone


def test_few_and_many_keys_have_the_words_of_numpys_philox():
    rng = np.random.Generator(np.random.PCG64(1))
    keys = rng.integers(0, 2**64, (2, 500), dtype=np.uint64)
    keys[:, :3] = [[0, 2**64 - 1, 2**32], [0, 2**64 - 1, 2**32 - 1]]
    counters = rng.integers(0, 2**63, 500)
    counters[:4] = 0, 1, 2**63 - 1, 2**32
    philox = [np.random.Philox(key=key, counter=int(at)) for key, at in zip(keys.T, counters, strict=True)]
    expected = np.array([each.advance(-1).random_raw(4) for each in philox]).T
    assert np.array_equal(philox_words(keys, counters), expected)
    for few in (0, 1, FEW, FEW + 1):
        assert np.array_equal(philox_words(keys[:, :few], counters[:few]), expected[:, :few])


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


def test_a_further_network_draws_others_and_shares_what_is_common():
    run, mesh, lora = Draws(5), Draws(5, "mesh"), Draws(5, "lora")
    names = ("emitter", "jammer", "slots")
    words = [draws.words(names, 0, 4).tolist() for draws in (run, mesh, lora)]
    assert words[0] != words[1] != words[2] != words[0]
    assert run.seed == 5
    assert Draws(5, "mesh").words(names, 0, 4).tolist() == words[1]
    assert Draws(6, "mesh").words(names, 0, 4).tolist() != words[1]
    for draws in (run, mesh, lora):
        assert draws.common.words(names, 0, 4).tolist() == words[0]
