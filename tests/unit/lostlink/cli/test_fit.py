"""`lostlink fit` takes the directory of a run, ended or killed, its Parquet, and the CSV of it alike."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from bridge.record.tables.deliveries import DeliveryWriter
from bridge.record.tables.every import finish_tables
from channel.link.radio import Radio
from channel.presets import load_radio
from lostlink.cli.records.fit import fit
from lostlink.export.csv_files import export_csv


def fitted(log: Path) -> Result:
    return CliRunner().invoke(fit, [str(log), "--radio", "corrected", "--json"])


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """As a killed run leaves it: packets over a range of distances, delivered as the radio says on average."""
    rng, radio = np.random.Generator(np.random.PCG64(1)), Radio(load_radio("corrected"))
    distance_m = rng.uniform(50.0, 1500.0, 3000)
    link = radio.link(distance_m)
    fading_db = -np.abs(rng.normal(0.0, 3.0, distance_m.size))
    delivered = rng.random(distance_m.size) > 1.0 / (1.0 + np.exp(link.snr_db + fading_db - 3.0))
    writer = DeliveryWriter(tmp_path, ("0", "1"))
    writer.append(
        distance_m.size,
        sim_time_ns=np.arange(distance_m.size),
        tx=0,
        rx=1,
        seq=np.arange(distance_m.size),
        length_bytes=324,
        distance_m=distance_m,
        received_power_dbm=link.received_power_dbm,
        snr_db=link.snr_db,
        per=np.nan,
        fate=np.where(delivered, 0, 1),
        received_ns=0,
    )
    writer.append(
        2,
        **dict.fromkeys(("sim_time_ns", "tx", "seq", "length_bytes", "received_ns"), 0),
        rx=1,
        fate=6,
        **dict.fromkeys(("distance_m", "received_power_dbm", "snr_db", "per"), np.nan),
    )
    writer.close()
    return tmp_path


def test_the_same_fit_from_whatever_a_run_left(run: Path) -> None:
    results = [fitted(run)]
    finish_tables(run)
    results.append(fitted(run))
    results.append(fitted(run / "deliveries.parquet"))
    export_csv(run, run)
    results.append(fitted(run / "deliveries.csv"))
    assert [result.exit_code for result in results] == [0] * 4, results[0].output
    found = [json.loads(result.output) for result in results]
    assert found[0]["packets"] == 3000
    assert 100 < found[0]["delivered"] < 2900
    assert all(each == found[0] for each in found)


def test_a_directory_that_is_no_run_is_refused(tmp_path: Path) -> None:
    done = fitted(tmp_path)
    assert done.exit_code != 0
    assert "has no deliveries.parquet" in done.output
    assert "Traceback" not in done.output
