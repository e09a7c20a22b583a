"""Functions that are public by themselves refuse what cannot be, with name, value and range."""

import numpy as np
import pytest

from channel import presets
from channel.checks import ChannelInputError
from channel.link.radio import Radio
from channel.phy import modulation

RADIO = Radio(presets.load_radio("corrected"))


@pytest.mark.parametrize(
    ("call", "name", "allowed"),
    [
        (lambda: modulation.ber_bpsk(np.nan), "ebn0", ">= 0"),
        (lambda: modulation.ber_qpsk([1.0, -2.0]), "ebn0", ">= 0"),
        (lambda: modulation.ber_square_qam(-1.0, 16), "ebn0", ">= 0"),
        (lambda: modulation.ber_square_qam(1.0, 8), "order", "4, 16, 64 or 256"),
        (lambda: RADIO.per(np.nan, 40), "snr_db", "finite"),
        (lambda: RADIO.per(10.0, -1), "length_bytes", ">= 0"),
        (lambda: RADIO.per("loud", 40), "snr_db", "finite"),
    ],
)
def test_what_cannot_be_is_refused_by_name(call, name, allowed):
    with pytest.raises(ChannelInputError) as caught:
        call()
    assert caught.value.name == name
    assert allowed in caught.value.allowed


def test_numbers_and_arrays_of_what_can_be_work():
    assert float(modulation.ber_bpsk(0.0)) == 0.5
    assert RADIO.per([-200.0, 200.0], 40) == pytest.approx([1.0, 0.0])
