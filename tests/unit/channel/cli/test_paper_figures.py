"""What the paper says of its figures, asked of ours."""

import numpy as np
import pytest

from channel.cli.paper_figures import FREQUENCIES_HZ, RADIOS, figure_data, write_figures


@pytest.fixture(scope="module")
def paper():
    return figure_data("moon2020")


def test_nothing_is_lost_near_and_nothing_arrives_afar(paper):
    assert paper.simulated[paper.bin_centres_m < 280.0].min() > 0.995
    assert paper.simulated[paper.bin_centres_m > 500.0].max() < 0.01
    between = (paper.bin_centres_m > 340.0) & (paper.bin_centres_m < 440.0)
    assert np.all((paper.simulated[between] > 0.01) & (paper.simulated[between] < 0.99))


def test_simulation_follows_the_closed_curve(paper):
    closed = np.array(
        [
            paper.curve[np.abs(paper.curve_distance_m - centre) <= 10.0].mean()
            for centre in paper.bin_centres_m
        ]
    )
    assert np.all(np.abs(paper.simulated - closed) < 3.29 * np.sqrt(closed * (1 - closed) / 500) + 0.005)


def test_power_falls_with_frequency_by_the_friis_term(paper):
    best = paper.by_frequency.max(axis=1)
    friis = 20.0 * np.log10(np.array(FREQUENCIES_HZ) / FREQUENCIES_HZ[0])
    assert best[0] - best == pytest.approx(friis, abs=0.2)


def test_the_shape_is_the_same_at_every_frequency_and_distance(paper):
    from scipy.stats import ks_2samp

    for samples in (paper.by_frequency, paper.by_distance):
        shapes = samples - samples.max(axis=1, keepdims=True)
        assert all(ks_2samp(shapes[0], other).pvalue > 1e-3 for other in shapes[1:])


def test_the_shape_is_one_sided_and_not_gaussian(paper):
    from scipy.stats import kstest, norm, skew

    for powers in paper.by_distance:
        assert skew(powers) < -0.5
        assert kstest(powers, norm(powers.mean(), powers.std()).cdf).pvalue < 1e-3
        noise_free = powers.max()
        assert noise_free - np.median(powers) == pytest.approx(6.0 * 0.6745, abs=0.7)


def test_files(tmp_path):
    files = write_figures(tmp_path / "out", ["moon2020"])
    assert {file.name for file in files} == {
        "fig5-moon2020.png",
        "fig5-moon2020.csv",
        "fig6-moon2020.png",
        "fig6-moon2020-power.csv",
        "fig6-moon2020-delivery.csv",
    }
    assert all(file.read_bytes().startswith(b"\x89PNG") for file in files if file.suffix == ".png")
    assert (tmp_path / "out" / "fig5-moon2020.csv").read_text().count("\n") == 1 + 8 * 500
    assert set(RADIOS) == {"moon2020", "moon2020-table3", "corrected"}
