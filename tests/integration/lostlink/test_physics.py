"""One effect of the channel each, from a scenario to its record; the oracles are formulas written here."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml

from tests import warm
from tests.integration.bridge.conftest import STILL

Fly = Callable[..., pd.DataFrame]
NO_RANDOM_TERMS = {"shadowing": {"model": "none"}, "fading": {"model": "none"}, "earth_radius_factor": None}
HEIGHT_M = 0.1
"""Of the antenna of a UA that stands on the ground."""


@pytest.fixture
def deliveries(tmp_path: Path, free_slot: Callable[[int], int]) -> Fly:
    """Flies still UA and whatever else a scenario has, and returns the table of deliveries."""

    def flown(
        radio: dict[str, Any], *nodes: dict[str, Any], duration_s: float = 1.0, **changes: Any
    ) -> pd.DataFrame:
        scenario = yaml.safe_load(
            STILL.format(speed="max", duration_s=duration_s, slot=free_slot(len(nodes)))
        )
        scenario |= {"radio": radio, "nodes": list(nodes), "fdm": {"standin_rate_hz": 100}} | changes
        return pd.read_parquet(warm.flown(scenario, tmp_path / "run").path / "deliveries.parquet")

    return flown


def ua(node: int, **home: float) -> dict[str, Any]:
    return {"id": node, "home": home, "agent": {"type": "still"}}


def tower(node: str = "tower", **place: float) -> dict[str, Any]:
    return {"id": node, "kind": "ground", "place": place, "agent": {"type": "still"}}


def test_the_ground_node_is_the_base_and_the_ua_the_aircraft(deliveries: Fly) -> None:
    """TR 36.777, table B-2, RMa-AV, with line of sight at 800 MHz: the UA counts as 10 m high, not the mast's 35 m."""
    cell = NO_RANDOM_TERMS | {"preset": "lte-like", "propagation": {"line_of_sight": "always"}}
    powers_dbm = deliveries(cell, ua(0), tower(north_m=650, height_m=35)).received_power_dbm
    slope = max(23.9 - 1.8 * np.log10(10.0), 20.0)
    loss_db = slope * np.log10(np.hypot(650.0, 34.9)) + 20.0 * np.log10(40.0 * np.pi * 0.8 / 3.0)
    assert powers_dbm.to_numpy() == pytest.approx(23.0 + 5.0 - loss_db, abs=0.01)


@pytest.mark.slow
def test_an_emitter_disturbs_by_what_falls_into_the_receivers_band(deliveries: Fly) -> None:
    """20 MHz of noise at 100 m: 130 kHz of it, 21.9 dB less, add to a floor of k T B + 6 dB; Rayleigh both ways."""
    radio = NO_RANDOM_TERMS | {
        "preset": "corrected",
        "bandwidth_hz": 130e3,
        "fading": {"model": "rayleigh"},
        "antenna": {"model": "isotropic", "gain_db": 0.0},
    }
    place = {"north_m": 60.0, "east_m": 100.0, "height_m": HEIGHT_M}
    emitter = {"id": "hum", "kind": "emitter", "place": place, "frequency_hz": 2.412e9, "power_dbm": 20.0}
    found = deliveries(radio, ua(0), ua(1, north_m=60.0), emitter | {"bandwidth_hz": 20e6}, duration_s=15.0)
    heard = found[found.rx == "1"]
    noise_dbm = (heard.received_power_dbm - heard.snr_db).to_numpy()
    first_m_db = 20.0 * np.log10(4.0 * np.pi * 2.412e9 / 299_792_458.0)
    hum_dbm = 20.0 - first_m_db - 50.0 + 10.0 * np.log10(0.13 / 20.0)
    floor_dbm = 10.0 * np.log10(1.380649e-23 * 290.0 * 130e3 * 1e3) + 6.0
    hum = (10 ** (noise_dbm / 10) - 10 ** (floor_dbm / 10)) / 10 ** (hum_dbm / 10)
    assert len(hum) > 290
    assert hum.mean() == pytest.approx(1.0, abs=0.2)
    assert np.quantile(hum, 0.5) == pytest.approx(np.log(2.0), abs=0.2)


def test_the_bulge_of_the_earth_is_in_the_record(deliveries: Fly) -> None:
    """Masts of 40 m, 60 km apart, at 2.4 GHz: ITU-R P.526-15, sec. 3.1.1, in its practical units."""
    radio = {"preset": "perfect", "frequency_hz": 2.4e9, "noise": {"model": "fixed", "floor_dbm": -330.0}}
    masts = tower("a", height_m=40), tower("b", north_m=60e3, height_m=40)
    found = deliveries(radio, ua(0), *masts)
    power_dbm = found[(found.tx == "a") & (found.rx == "b")].received_power_dbm
    radius_km = 4.0 / 3.0 * 6371.0
    x = 2.188 * 2400.0 ** (1 / 3) * radius_km ** (-2 / 3) * 60.0
    y = 9.575e-3 * 2400.0 ** (2 / 3) * radius_km ** (-1 / 3) * 40.0
    gain_db = 17.6 * np.sqrt(y - 1.1) - 5.0 * np.log10(y - 1.1) - 8.0
    bulge_db = -(11.0 + 10.0 * np.log10(x) - 17.6 * x) - 2.0 * gain_db
    free_db = 20.0 * np.log10(4.0 * np.pi * 60e3 * 2.4e9 / 299_792_458.0)
    assert x > 1.6
    assert y > 2.0
    assert power_dbm.to_numpy() == pytest.approx(18.0 + 4.6 - free_db - bulge_db, abs=0.1)


def test_ua_side_by_side_are_shadowed_alike_on_the_radio_and_in_their_sensors(
    deliveries: Fly, tmp_path: Path
) -> None:
    """Gudmundson over 1 km, sigma 12 dB: UA 1 m apart differ by a sigma of 12 sqrt(2 (1 - exp(-0.001))), 0.54 dB."""
    shadowing = {"model": "gudmundson", "sigma_db": 12.0, "decorrelation_m": 1000.0}
    radio = NO_RANDOM_TERMS | {"preset": "corrected", "shadowing": shadowing}
    sensor = {"radio": {"preset": "rf-sensor", "shadowing": shadowing, "fading": {"model": "none"}}}
    beacon = {"id": "beacon", "kind": "emitter", "frequency_hz": 433.92e6, "power_dbm": 60.0}
    pair = [each | {"sensor": sensor} for each in (ua(0), ua(1, east_m=1.0))]
    place = {"north_m": 300.0, "height_m": 30.0}
    found = deliveries(radio, *pair, tower(**place), beacon | {"place": place}, duration_s=0.3)
    heard_dbm = found[found.tx == "tower"].groupby("rx").received_power_dbm.first()
    [run] = (tmp_path / "run").iterdir()
    sensed_db = pd.read_parquet(run / "measurements.parquet").groupby("node").shadowing_db.first()
    for beside in (heard_dbm, sensed_db):
        assert abs(beside["0"] - beside["1"]) < 4.0 * 0.54
