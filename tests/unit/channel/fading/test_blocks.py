"""Fading in blocks of a coherence time."""

import numpy as np
import pytest
from scipy.stats import kstest

from channel.fading.blocks import block_uniforms, coherence_octave, coherence_time_s
from channel.fading.link_words import LinkWords

NODES = [f"n{i}" for i in range(60)]
WORDS = LinkWords(4, NODES, "fields")
TX, RX = np.triu_indices(len(NODES), 1)


def uniforms(tx, rx, times_ns, coherence_s):
    times = np.broadcast_to(np.asarray(times_ns), np.shape(tx))
    return block_uniforms(WORDS.of_pair(tx, rx), times, np.broadcast_to(coherence_s, np.shape(tx)))


def test_the_coherence_time_is_the_textbooks():
    assert float(coherence_time_s(np.asarray(20.0), 2.4e9, 1.0)) == pytest.approx(
        9 / (16 * np.pi) / (20.0 * 2.4e9 / 299792458.0)
    )
    assert float(coherence_time_s(np.asarray(0.0), 2.4e9, 1.0)) == 1.0


def test_blocks_are_powers_of_two_in_ns_rounded_down():
    times_s = np.array([0.5, 2**20 * 1e-9, (2**20 - 1) * 1e-9, 1.0, 1e-9])
    assert coherence_octave(times_s).tolist() == [28, 20, 19, 29, 0]


def test_a_draw_holds_for_a_block_and_both_directions():
    length = 2**29
    first = uniforms(TX, RX, 5 * length, 0.6)
    last = uniforms(RX, TX, 6 * length - 1, 0.6)
    after = uniforms(TX, RX, 6 * length, 0.6)
    assert np.array_equal(first, last)
    assert np.all(np.asarray(first) != after)


def test_draws_are_uniform_and_independent():
    first, second = uniforms(TX, RX, 10**9, 0.6)
    later, _ = uniforms(TX, RX, 3 * 10**9, 0.6)
    shorter, _ = uniforms(TX, RX, 10**9, 0.1)
    assert kstest(first, "uniform").pvalue > 1e-3
    assert kstest(second, "uniform").pvalue > 1e-3
    for other in (second, later, shorter):
        assert abs(np.corrcoef(first, other)[0, 1]) < 3.29 / np.sqrt(len(TX))
