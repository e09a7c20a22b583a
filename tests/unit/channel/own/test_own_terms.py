"""A user's own shadowing, fading, noise and bursts: what they say is what a run does."""

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from channel import presets
from channel.link.radio import Radio
from channel.medium.medium import Medium
from channel.medium.reception import FATES, Fate
from channel.presets import PresetError
from lostlink.cli.main import lostlink

EXAMPLE = Path(__file__).parents[4] / "examples" / "models" / "my_models.py"
OWN = {
    "shadowing": {"class": f"{EXAMPLE}:Laplacian", "sigma_db": 4.0},
    "fading": {"class": f"{EXAMPLE}:Weibull", "shape": 3.0, "coherence": "block"},
    "noise": {"class": f"{EXAMPLE}:RooftopNoise", "town_db": 7.0},
    "bursts": {"class": f"{EXAMPLE}:Radar", "period_s": 2.0, "lost_s": 0.5},
}


def radio_with(*groups):
    return Radio(presets.load_radio("corrected", {group: OWN[group] for group in groups}))


def settled(radio, times_ns):
    """One packet at each time over 100 m."""
    medium = Medium(radio, seed=3, nodes=("a", "b"))
    for time_ns in (0, int(times_ns[-1])):
        medium.observe("a", time_ns, (0.0, 0.0, -40.0))
        medium.observe("b", time_ns, (100.0, 0.0, -40.0))
    medium.send(medium.packets(tx="a", seq=np.arange(times_ns.size), length_bytes=40, sim_time_ns=times_ns))
    return medium.settle()


def test_check_takes_every_kind_and_the_shipped_example(tmp_path):
    for name, radio in (
        ("own", OWN),
        ("forest", {"propagation": {"class": f"{EXAMPLE}:ThroughForest", "depth_m": 80.0}}),
    ):
        file = tmp_path / f"{name}.yaml"
        tree = {"extends": "separation", "name": name, "radio": {"preset": "corrected", **radio}}
        file.write_text(json.dumps(tree))
        result = CliRunner().invoke(lostlink, ["check", str(file)], catch_exceptions=False)
        assert result.exit_code == 0, result.output


def test_own_shadowing_is_drawn_and_averaged():
    radio, plain = radio_with("shadowing"), radio_with()
    drawn = settled(radio, np.arange(4000) * 10_000_000).received_power_dbm
    loss_db = float(plain.link(100.0).received_power_dbm) - drawn
    assert np.mean(np.abs(loss_db)) == pytest.approx(
        4.0 / np.sqrt(2.0), rel=0.06
    )  # of a normal law it is 3.19
    at = np.array([900.0])
    law = radio.config.shadowing
    losses = law.loss_db(np.random.Generator(np.random.PCG64(2)).standard_normal(100_000))
    snr = float(plain.link(900.0).snr_db) - losses
    assert float(radio.probability_of_delivery(at)[0]) == pytest.approx(
        1.0 - float(np.mean(radio.per(snr, 40))), abs=0.01
    )


def test_own_fading_lasts_as_its_coherence_says():
    times_ns = np.arange(400) * 10_000_000
    drawn = {}
    for coherence in ("block", "packet"):
        tree = {"fading": OWN["fading"] | {"coherence": coherence}, "shadowing": {"model": "none"}}
        powers_dbm = settled(Radio(presets.load_radio("corrected", tree)), times_ns).received_power_dbm
        drawn[coherence] = len(np.unique(powers_dbm))
    assert drawn["block"] <= 10  # ends that stand still: once a second, rounded down to a power of two
    assert drawn["packet"] > 390


OUTAGE = """
import numpy as np
from channel.fading.laws import CoherentFading


class Outage(CoherentFading):
    depth_db: float

    @property
    def left_db(self):
        return self.depth_db if self.depth_db > -1e9 else -np.inf

    def gain_db(self, first, second, elevation_deg):
        return np.where(np.asarray(first) < 0.2, self.left_db, 0.0) + 0.0 * elevation_deg

    def rule(self, elevation_deg, panels):
        shape = np.shape(elevation_deg)
        return np.broadcast_to([self.left_db, 0.0], (*shape, 2)), np.broadcast_to([0.2, 0.8], (*shape, 2))
"""


@pytest.mark.parametrize("depth_db", [-40.0, -1e8, -1e9])
def test_own_fading_may_leave_nothing(depth_db, tmp_path):
    file = tmp_path / "outage.py"
    file.write_text(OUTAGE)
    still = {"shadowing": {"model": "none"}}
    fading = {"class": f"{file}:Outage", "depth_db": depth_db}
    radio = Radio(presets.load_radio("corrected", still | {"fading": fading}))
    plain = Radio(presets.load_radio("corrected", still | {"fading": {"model": "none"}}))
    distance_m = np.array([100.0, 1000.0])
    wanted = 0.8 * plain.probability_of_delivery(distance_m)
    assert radio.probability_of_delivery(distance_m) == pytest.approx(wanted, abs=1e-5)


def test_own_noise_and_bursts():
    radio = radio_with("noise", "bursts")
    assert radio.noise_floor_dbm == pytest.approx(
        -173.975 + 10.0 * np.log10(radio.config.bandwidth_hz) + 7.0, abs=0.01
    )
    times_ns = np.arange(200) * 20_000_000
    lost = settled(radio, times_ns).fate != FATES.index(Fate.DELIVERED)
    assert np.array_equal(lost, times_ns / 1e9 % 2.0 < 0.5)


@pytest.mark.parametrize(
    ("group", "lacks"),
    [
        ("shadowing", "is_random"),
        ("noise", "noise_floor_dbm"),
        ("bursts", "mean_loss"),
        ("fading", "coherence"),
    ],
)
def test_a_class_that_lacks_something_is_named(group, lacks):
    tree = {group: {"class": f"{EXAMPLE}:Cardioid"}}
    with pytest.raises(PresetError, match=f"Cardioid in .*has no .*{lacks}"):
        presets.load_radio("corrected", tree)
