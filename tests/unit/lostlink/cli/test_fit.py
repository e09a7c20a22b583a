"""`lostlink fit` takes the directory of a run, ended or killed, its Parquet, and the CSV of it alike."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from bridge.record.tables.deliveries import DeliveryWriter, Vocabulary
from bridge.record.tables.every import finish_tables
from channel.link.radio import Radio
from channel.presets import load_radio
from lostlink.cli.records.fit import fit
from lostlink.export.csv_files import export_csv


def fitted(log: Path, *options: str) -> Result:
    return CliRunner().invoke(fit, [str(log), "--radio", "corrected", "--json", *options])


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


@pytest.mark.slow
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


def packets(run: Path, radio: str, exponent: float, attempts: int = 1) -> None:
    """Packets of a network, whose losses grow with distance as the exponent says."""
    rng = np.random.Generator(np.random.PCG64(2))
    distance_m = rng.uniform(50.0, 1500.0, 2000)
    snr_db = 8.0 - 10.0 * exponent * np.log10(distance_m / 500.0)
    words = Vocabulary()
    writer = DeliveryWriter(run, ("0", "1"), words)
    for name, lost in ((radio, snr_db < rng.normal(4.0, 3.0, 2000)), ("other", distance_m < 1e9)):
        writer.append(
            2000,
            sim_time_ns=np.arange(2000),
            tx=0,
            rx=1,
            seq=np.arange(2000),
            length_bytes=324,
            distance_m=distance_m,
            **dict.fromkeys(("received_power_dbm", "snr_db", "per"), np.nan),
            fate=lost.astype(int),
            radio=words.places("radio", [name])[0],
            received_ns=0,
            attempts=attempts,
        )
    writer.close()


def left_by(run: Path, kind: str) -> Path:
    """A run's packets, as its directory or a file of them."""
    finish_tables(run)
    if kind == "csv":
        export_csv(run, run)
    return run if kind == "run" else run / f"deliveries.{kind}"


KINDS = pytest.mark.parametrize("kind", ["run", "parquet", "csv"])


@KINDS
def test_a_fit_is_of_one_network(tmp_path: Path, kind: str) -> None:
    """Beside one that brought nothing over; both together had half of the packets near by lost."""
    packets(tmp_path, "main", 2.5)
    log = left_by(tmp_path, kind)
    found = json.loads(fitted(log).output)
    assert found["packets"] == 2000
    assert found["radio"]["base_loss"] < 0.05
    assert "none of 2000 packets arrived" in fitted(log, "--network", "other").output
    assert "has packets of main, other" in fitted(log, "--network", "mesh").output


@KINDS
def test_packets_that_were_tried_again_are_no_trials_of_a_radio(tmp_path: Path, kind: str) -> None:
    packets(tmp_path, "main", 2.5, attempts=3)
    done = fitted(left_by(tmp_path, kind))
    assert done.exit_code != 0
    assert "2000 of 2000 packets of network main were on the air more than once" in done.output


def test_a_directory_that_is_no_run_is_refused(tmp_path: Path) -> None:
    done = fitted(tmp_path)
    assert done.exit_code != 0
    assert "has no deliveries.parquet" in done.output
    assert "Traceback" not in done.output
