"""Flight logs from columns: Parquet, or the table of a run."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from channel.config import RadioConfig
from channel.fit.flight_log import (
    ALL_RECEIVERS,
    BEFORE_THE_RADIO,
    COLUMNS,
    MAIN,
    NO_OUTCOME,
    OF_A_RUN,
    FlightLog,
    FlightLogError,
    links_of,
    read_csv_log,
    single_trials,
)


def read_log(file: Path, base: RadioConfig, network: str = MAIN) -> FlightLog:
    """Read a flight log: Parquet if the file's name ends in .parquet, else CSV.

    Raises:
        FlightLogError: no such file, a missing column, a value that is none, or a run that cannot be fitted.
    """
    read = read_parquet_log if file.suffix.lower() == ".parquet" else read_csv_log
    return read(file, base, network)


def read_parquet_log(file: Path, base: RadioConfig, network: str = MAIN) -> FlightLog:
    """Read a Parquet file with the columns that `log_of_columns` takes.

    Raises:
        FlightLogError: no such file, a missing column, a value that is none, or a run that cannot be fitted.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        with file.open("rb") as source:
            parquet = pq.ParquetFile(source)
            present = [name for name in COLUMNS if name in parquet.schema_arrow.names]
            table = parquet.read(columns=present, use_threads=False)
            columns = {name: np.asarray(table.column(name)) for name in present}
    except (pa.ArrowException, KeyError, OSError) as error:  # KeyError: a column that is there twice
        reason = error.strerror if isinstance(error, OSError) and error.strerror else error
        raise FlightLogError(f"cannot read {file}: {reason}") from error
    return log_of_columns(columns, base, str(file), network)


def log_of_columns(
    columns: Mapping[str, NDArray[Any]], base: RadioConfig, place: str, network: str = MAIN
) -> FlightLog:
    """Make a flight log of `distance_m`, `delivered` or `fate`, and optional `length_bytes`, `rssi_dbm`, `tx` and `rx`.

    They mean what they mean in a CSV (`channel.fit.flight_log.read_flight_log`): packets that never came to the radio
    and lost ones whose distance is not known are left out, and lengths are as the radio counts them (`read_csv_log`).

    Args:
        columns: arrays of one length, by name.
        base: the radio to start from.
        place: where they are from, for errors.
        network: of a run's deliveries, which radio network's.

    Raises:
        FlightLogError: a missing column, a value that is none, no row, or a run that cannot be fitted.
    """
    if "distance_m" not in columns:
        raise FlightLogError(f"{place}: has no column distance_m")
    if not {"fate", "delivered"} & columns.keys():
        raise FlightLogError(f"{place}: {NO_OUTCOME}")
    if not all(isinstance(each, str) for each in columns.get("fate", ())):
        raise FlightLogError(f"{place}: fate: has to be a text in every row")
    if columns.keys() >= OF_A_RUN:
        mine = single_trials(columns["radio"], columns["attempts"], network, place)
        columns = {name: values[mine] for name, values in columns.items()}
    delivered = columns["fate"] == "delivered" if "fate" in columns else columns["delivered"]
    try:
        distance_m = columns["distance_m"].astype(float)
        known = _on_the_air(columns, distance_m, delivered)
        log = FlightLog(
            distance_m[known],
            delivered[known],
            _lengths(columns, base, len(distance_m))[known],
            columns.get("rssi_dbm", np.full(len(distance_m), np.nan)).astype(float)[known],
            _links(columns, known),
        )
    except (TypeError, ValueError) as error:
        raise FlightLogError(f"{place}: {error}") from error
    if not log.packets:
        raise FlightLogError(f"{place}: no rows")
    return log


def _on_the_air(
    columns: Mapping[str, NDArray[Any]], distance_m: NDArray[np.float64], delivered: NDArray[Any]
) -> NDArray[np.bool_]:
    """Return which rows are packets that the radio sent between known places."""
    known = np.ones(len(distance_m), dtype=bool)
    if "fate" in columns:
        known &= ~np.isnan(distance_m) | (delivered != 0)
        known &= ~np.isin(columns["fate"].astype(str), list(BEFORE_THE_RADIO))
    if "rx" in columns:
        known &= columns["rx"].astype(str) != ALL_RECEIVERS
    return known


def _links(columns: Mapping[str, NDArray[Any]], known: NDArray[np.bool_]) -> NDArray[np.intp]:
    if not {"tx", "rx"} <= columns.keys():
        return np.zeros(int(np.count_nonzero(known)), dtype=np.intp)
    return links_of(*(columns[end][known].astype(str).tolist() for end in ("tx", "rx")))


def _lengths(columns: Mapping[str, NDArray[Any]], base: RadioConfig, packets: int) -> NDArray[np.float64]:
    if "length_bytes" in columns and base.length.model != "fixed":
        return columns["length_bytes"].astype(np.float64)
    return np.full(packets, float(base.length.length_bytes(base.nominal_payload_bytes)))
