"""Every propagation and error model: finite, reciprocal, monotone, without a warning."""

from typing import get_args

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from channel.config import Error, Propagation
from channel.geometry import Path
from channel.phy.error_model import (
    Band,
    ErfcBytes,
    Lossless,
    NoncoherentFsk,
    SnrTable,
    Threshold,
    UncodedAwgn,
)
from channel.phy.ofdm import OfdmNist, OfdmYans
from channel.propagation.air_to_ground import AlHourani, RmaAv, UmaAv
from channel.propagation.gain_map import GainMap
from channel.propagation.hata import Cost231Hata, OkumuraHata
from channel.propagation.path_loss import FreeSpace, LogDistance, NoPathLoss
from channel.propagation.terrain import Terrain
from channel.propagation.two_ray import TwoRay, TwoSlope

MONOTONE = [
    FreeSpace(),
    LogDistance(exponent=3.3),
    TwoSlope(),
    *[
        OkumuraHata(environment=e, city=c, outside="clamp")
        for e in ("urban", "open")
        for c in ("small", "large")
    ],
    Cost231Hata(city="large", outside="clamp"),
    RmaAv(line_of_sight="always", outside="clamp"),
    UmaAv(line_of_sight="always", outside="clamp"),
]
BY_SIGHT = [
    TwoRay(),
    TwoRay(polarisation="horizontal", roughness_m=0.05),
    AlHourani(environment="urban", outside="clamp"),
    RmaAv(outside="clamp"),
    UmaAv(outside="clamp"),
]
ERRORS = [
    ErfcBytes(),
    *[UncodedAwgn(modulation=m) for m in ("bpsk", "qpsk", "16qam", "64qam")],
    *[model(rate_mbps=rate) for model in (OfdmNist, OfdmYans) for rate in (6, 9, 12, 18, 24, 36, 48, 54)],
    *[NoncoherentFsk(coding=coding) for coding in ("none", "golay")],
    SnrTable(table=((0.0, 1.0), (5.0, 0.5), (9.0, 0.0))),
    Threshold(snr_min_db=3.0),
]
BAND = Band(20e6, 12e6)
heights = st.floats(1.0, 300.0)

NEED_FILES = (GainMap, Terrain)
NOTHING = (NoPathLoss, Lossless)


def test_no_model_is_left_out() -> None:
    """Each that a radio may name is tried below; those that need a file have tests of their own."""
    tried = {type(each) for each in (*MONOTONE, *BY_SIGHT, *ERRORS)}
    named = {each for union in (Propagation, Error) for each in get_args(get_args(union)[0])}
    assert named - tried == {*NEED_FILES, *NOTHING}


@settings(deadline=None, max_examples=60)
@given(
    distance=st.floats(1.0, 1e5), times=st.floats(1.0, 10.0), tx=heights, rx=heights, f=st.floats(1e8, 6e9)
)
def test_path_loss(distance, times, tx, rx, f):
    slant = np.array([distance, distance * times]) + abs(tx - rx)
    for model in MONOTONE + BY_SIGHT:
        loss = model.path_loss_db(Path(f, slant, tx, rx)._replace(tx_is_base=True, rx_is_base=False))
        assert np.all(np.isfinite(loss))
        back = Path(f, slant, rx, tx)._replace(tx_is_base=False, rx_is_base=True)
        assert loss == pytest.approx(model.path_loss_db(back), abs=1e-9)
        if model in MONOTONE:
            assert loss[0] <= loss[1] + 1e-9, model


@settings(deadline=None, max_examples=60)
@given(
    snr_db=st.floats(-400.0, 400.0),
    more_db=st.floats(0.0, 50.0),
    length=st.integers(0, 2300),
    more=st.integers(0, 500),
)
def test_error_rates(snr_db, more_db, length, more):
    snr = np.array([snr_db, snr_db + more_db])
    for model in ERRORS:
        ber, per = model.ber(snr, BAND), model.per(snr, float(length), BAND)
        longer = model.per(snr, float(length + more), BAND)
        for rate in (ber, per):
            assert np.all((rate >= 0.0) & (rate <= 1.0)), model
            assert rate[1] <= rate[0] + 1e-12, model
        assert np.all(per <= longer + 1e-12), model
