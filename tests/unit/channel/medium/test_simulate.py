import pytest

from channel import presets
from channel.checks import ChannelInputError
from channel.draws import Draws
from channel.link.radio import Radio
from channel.medium.medium import Fate, Medium
from channel.medium.simulate import simulate
from tests.unit.channel.medium.one_by_one import transmitted


@pytest.mark.parametrize("name", ["moon2020", "corrected", "disk", "gazebo-classic"])
@pytest.mark.parametrize("fading", ["none", "rayleigh"])
def test_batches_have_the_fates_of_the_medium(name, fading):
    radio = Radio(presets.load_radio(name, {"base_loss": 0.1, "fading": {"model": fading}}))
    distance = {"gazebo-classic": 11.0}.get(name, 395.0)
    batch = simulate(radio, Draws(5), [("0", "1"), ("1", "0")], distance, packets=60, first_seq=250)
    medium = Medium(radio, seed=5, nodes=["0", "1"])
    medium.place("0", (0, 0, -40))
    medium.place("1", (distance, 0, -40))
    for row, tx in enumerate("01"):
        for k in range(60):
            (one,) = transmitted(medium, tx, 250 + k, 0, 40)
            assert batch.delivered[row, k] == (one.fate is Fate.DELIVERED)
            assert batch.received_power_dbm[row, k] == pytest.approx(one.received_power_dbm, abs=1e-9)
            assert batch.per[row, k] == pytest.approx(one.per, abs=1e-12)


def test_radios_that_time_or_place_changes_are_refused():
    radio = Radio(presets.load_radio("wifi-2.4"))
    with pytest.raises(ChannelInputError, match=r"shadowing\.model"):
        simulate(radio, Draws(1), [("0", "1")], 100.0, packets=1)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"distance_m": [[1.0], [2.0]], "packets": 3}, r"distance_m = .*shape \(2, 1\).*\(1, 3\)"),
        ({"distance_m": [[1.0, 2.0]], "packets": 3}, r"distance_m = .*shape \(1, 2\)"),
        ({"distance_m": 1.0, "packets": -1}, "packets = -1"),
    ],
)
def test_shapes_that_do_not_fit_are_refused(arguments, words):
    radio = Radio(presets.load_radio("moon2020"))
    with pytest.raises(ChannelInputError, match=words):
        simulate(radio, Draws(1), [("a", "b")], **arguments)
