"""Columns make the same flight log as a CSV with the same numbers."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq
import pytest

from channel.fit.columns import log_of_columns, read_log
from channel.fit.flight_log import FlightLogError
from channel.presets import load_radio

COLUMNS = {
    "distance_m": [10.0, 20.5, float("nan"), 40.0],
    "fate": ["delivered", "out_of_range", "no_position", "channel_erasure"],
    "length_bytes": [324, 10, 324, 0],
    "rssi_dbm": [-60.25, float("nan"), float("nan"), float("nan")],
    "tx": ["0", "1", "0", "1"],
}


@pytest.mark.parametrize("radio", ["corrected", "moon2020"])
@pytest.mark.parametrize("drop", [(), ("rssi_dbm",), ("length_bytes",), ("rssi_dbm", "length_bytes")])
def test_parquet_reads_as_csv_does(tmp_path, radio, drop):
    table = pa.table({name: values for name, values in COLUMNS.items() if name not in drop})
    pq.write_table(table, tmp_path / "log.parquet")
    pyarrow.csv.write_csv(table, tmp_path / "log.csv")
    one, other = (read_log(tmp_path / f"log.{kind}", load_radio(radio)) for kind in ("parquet", "csv"))
    assert one.delivered.tolist() == [True, False, False]
    for name in ("distance_m", "delivered", "length_bytes", "rssi_dbm"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def test_names_may_be_a_dictionary_and_delivered_a_boolean(tmp_path):
    fates = pa.array(COLUMNS["fate"]).dictionary_encode()
    pq.write_table(pa.table({"distance_m": COLUMNS["distance_m"], "fate": fates}), tmp_path / "a.parquet")
    delivered = [True, False, True, False]
    pq.write_table(pa.table({"distance_m": [1, 2, 3, 4], "delivered": delivered}), tmp_path / "b.parquet")
    first, second = (read_log(tmp_path / f"{name}.parquet", load_radio("corrected")) for name in "ab")
    assert first.delivered.tolist() == [True, False, False]
    assert second.delivered.tolist() == delivered


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        ({"fate": ["delivered"]}, "has no column distance_m"),
        ({"distance_m": [1.0]}, "has no column delivered"),
        ({"distance_m": [-1.0], "delivered": [1]}, r"distance_m = -1\.0"),
        ({"distance_m": [float("nan")], "delivered": [0]}, "distance_m = nan"),
        ({"distance_m": [float("nan")], "fate": ["delivered"]}, "distance_m = nan"),
        ({"distance_m": ["far"], "delivered": [1]}, "far"),
        ({"distance_m": [1.0], "delivered": [2]}, "delivered = 2"),
        ({"distance_m": [1.0], "delivered": ["maybe"]}, "delivered"),
        ({"distance_m": [float("nan")], "fate": ["no_position"]}, "no rows"),
        ({"distance_m": [], "fate": []}, "no rows"),
        ({"distance_m": [1.0, 2.0], "fate": ["delivered", None]}, "fate: has to be a text in every row"),
        ({"distance_m": [1.0], "fate": [b"delivered"]}, "fate: has to be a text in every row"),
        ({"distance_m": [1.0], "fate": [{"is": "delivered"}]}, "fate: has to be a text in every row"),
        ({"distance_m": [1.0], "delivered": [1], "tx": [{"id": 0}]}, "tx: has to be a text in every row"),
        ({"distance_m": [1.0], "delivered": [1], "rx": [["0", "1"]]}, "rx: has to be a text in every row"),
    ],
)
def test_what_is_no_log_is_refused_with_its_place(columns, words):
    arrays = {name: np.array(values) for name, values in columns.items()}
    with pytest.raises(FlightLogError, match=words) as caught:
        log_of_columns(arrays, load_radio("corrected"), "my.parquet")
    assert str(caught.value).startswith("my.parquet: ")


def test_packets_that_never_came_to_the_radio_are_left_out(tmp_path):
    """As a run's deliveries have them: lost together in one row, refused, or sent with an end at no known place."""
    columns = {
        "tx": ["0", "0", "1", "0", "1", "0"],
        "rx": ["1", "all", "0", "1", "0", "2"],
        "packets": [1, 40, 1, 1, 1, 1],
        "distance_m": [10.0, float("nan"), 12.0, 14.0, 16.0, 18.0],
        "fate": ["delivered", "transport", "channel_erasure", "too_long", "transport", "base_loss"],
    }
    pq.write_table(pa.table(columns), tmp_path / "log.parquet")
    pyarrow.csv.write_csv(pa.table(columns), tmp_path / "log.csv")
    for kind in ("parquet", "csv"):
        log = read_log(tmp_path / f"log.{kind}", load_radio("corrected"))
        assert log.distance_m.tolist() == [10.0, 12.0, 18.0]
        assert log.delivered.tolist() == [True, False, False]
        assert log.link.tolist() == [0, 0, 1]  # both directions of a pair are one link


def test_a_file_that_is_no_parquet_is_refused(tmp_path):
    (tmp_path / "a.parquet").write_bytes(b"PAR1 and nothing")
    for name in ("a", "b"):
        with pytest.raises(FlightLogError, match=rf"cannot read .*{name}\.parquet"):
            read_log(tmp_path / f"{name}.parquet", load_radio("corrected"))


def test_a_column_that_is_there_twice_is_refused(tmp_path):
    columns = [pa.array([1.0]), pa.array([2.0]), pa.array([1])]
    pq.write_table(pa.table(columns, ["distance_m", "distance_m", "delivered"]), tmp_path / "a.parquet")
    with pytest.raises(FlightLogError, match=r"cannot read .*a\.parquet: .*distance_m"):
        read_log(tmp_path / "a.parquet", load_radio("corrected"))
