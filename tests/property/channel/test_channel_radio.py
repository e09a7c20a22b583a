import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from channel import presets
from channel.checks import ChannelInputError
from channel.link.radio import Radio

RADIOS = {name: Radio(presets.load_radio(name)) for name in presets.preset_names()}
names = st.sampled_from(sorted(RADIOS))
distances = st.floats(0.0, 1e6)
lengths = st.integers(0, 2000)


@settings(deadline=None, max_examples=150)
@given(name=names, near=distances, more=st.floats(0, 1e5), length=lengths)
def test_rates_are_probabilities_and_loss_grows_with_distance(name, near, more, length):
    link = RADIOS[name].link([near, near + more], length_bytes=length)
    for rate in (link.per, link.ber):
        assert np.all((rate >= 0.0) & (rate <= 1.0))
    if RADIOS[name].config.propagation.model != "two-ray":  # two rays interfere
        assert link.path_loss_db[0] <= link.path_loss_db[1] + 1e-9
        assert link.per[0] <= link.per[1] + 1e-12
    assert np.all(np.isfinite([link.path_loss_db, link.received_power_dbm, link.snr_db]))


@settings(deadline=None, max_examples=100)
@given(
    name=names,
    snr_db=st.floats(-1e4, 1e4),
    more_db=st.floats(0, 100),
    length=lengths,
    more=st.integers(0, 500),
)
def test_per_falls_with_snr_and_grows_with_length(name, snr_db, more_db, length, more):
    radio = RADIOS[name]
    per = radio.per(np.array([snr_db, snr_db + more_db]), float(length))
    assert per[1] <= per[0] + 1e-12
    longer = radio.per(np.array([snr_db]), float(length + more))
    assert per[0] <= longer[0] + 1e-12


@settings(deadline=None, max_examples=60)
@given(
    name=names,
    tx=st.tuples(*[st.floats(-2000, 2000)] * 2, st.floats(-500, -2)),
    rx=st.tuples(*[st.floats(-2000, 2000)] * 2, st.floats(-500, -2)),
)
def test_links_are_reciprocal(name, tx, rx):
    radio = RADIOS[name]
    there = radio.link(position_tx_ned_m=tx, position_rx_ned_m=rx)
    back = radio.link(position_tx_ned_m=rx, position_rx_ned_m=tx, base="rx")
    assert there.received_power_dbm == pytest.approx(back.received_power_dbm, abs=1e-9)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -1.0, [1.0, -2.0], "far", None])
def test_bad_distances_raise_with_the_name(bad):
    with pytest.raises(ChannelInputError, match=r"distance_m = .*allowed is"):
        RADIOS["moon2020"].link(bad)


def test_shapes_that_do_not_fit_raise_with_the_names():
    with pytest.raises(ChannelInputError, match=r"distance_m and .*height_tx_m"):
        RADIOS["moon2020"].link([100.0, 200.0], height_tx_m=[40.0, 41.0, 42.0])
    with pytest.raises(ChannelInputError, match="position_tx_ned_m"):
        RADIOS["moon2020"].link(position_tx_ned_m=[1.0, 2.0], position_rx_ned_m=[0.0, 0.0, 0.0])


@pytest.mark.parametrize(
    ("geometry", "words"),
    [
        (
            {"slant_distance_m": 100.0, "ground_distance_m": 50.0},
            "distance_m = 100.0: allowed is .*one of them",
        ),
        (
            {"slant_distance_m": 9.0, "position_tx_ned_m": [0, 0, -1], "position_rx_ned_m": [1, 0, -1]},
            "one of them",
        ),
        ({"position_tx_ned_m": [0, 0, -1]}, "position_rx_ned_m = None"),
        (
            {"slant_distance_m": [1.0, 2.0], "attitude_tx_wxyz": [[1, 0, 0, 0]] * 3},
            r"attitude_tx_wxyz.*\(3,\)",
        ),
        ({"slant_distance_m": 9.0, "attitude_rx_wxyz": [0, 0, 0, 0]}, "attitude_rx_wxyz = .*length about 1"),
        ({"slant_distance_m": 1e300}, r"distance_m = 1e\+300: .*<= 1e\+12"),
        ({"ground_distance_m": 9.0, "height_tx_m": 1e200}, r"height_tx_m = 1e\+200"),
        ({"position_tx_ned_m": [0, 0, -1e200], "position_rx_ned_m": [1, 0, -1]}, "position_tx_ned_m = -1e"),
        ({"slant_distance_m": 9.0, "frequency_hz": 1e300}, r"frequency_hz = 1e\+300"),
        ({"slant_distance_m": 9.0, "length_bytes": 1.7e308}, r"length_bytes = 1.7e\+308"),
    ],
)
def test_geometry_that_cannot_be_raises_with_the_name(geometry, words):
    with pytest.raises(ChannelInputError, match=words):
        RADIOS["wifi-2.4"].link(**geometry)


def test_attitudes_count_by_their_direction():
    level = RADIOS["wifi-2.4"].link(100.0)
    long = RADIOS["wifi-2.4"].link(100.0, attitude_tx_wxyz=[1.5, 0, 0, 0])
    assert long.received_power_dbm == pytest.approx(level.received_power_dbm, abs=1e-9)


def test_arrays_broadcast_and_scalars_work():
    radio = RADIOS["moon2020"]
    table = radio.probability_of_delivery(np.array([[300.0], [400.0]]), [40, 100, 200])
    assert table.shape == (2, 3)
    assert float(radio.probability_of_delivery(400.0)) == pytest.approx(float(table[1, 0]))


def test_an_argument_that_is_not_there_is_named():
    with pytest.raises(TypeError, match="'foo'"):
        RADIOS["corrected"].link(500.0, foo=1)
