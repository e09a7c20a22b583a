"""Flight logs from columns: Parquet, or the table of a run."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

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
    words = {
        name: _Words.of(columns[name], f"{place}: {name}") for name in ("fate", "tx", "rx") if name in columns
    }
    if "fate" in words and not all(isinstance(each, str) for each in words["fate"].names):
        raise FlightLogError(f"{place}: fate: has to be a text in every row")
    mine = np.ones(len(columns["distance_m"]), dtype=bool)
    if columns.keys() >= OF_A_RUN:
        mine = single_trials(columns["radio"], columns["attempts"], network, place)
    delivered = words["fate"].where("delivered") if "fate" in words else columns["delivered"]
    try:
        distance_m = columns["distance_m"].astype(float)
        known = mine & _on_the_air(words, distance_m, delivered)
        log = FlightLog(
            distance_m[known],
            delivered[known],
            _lengths(columns, base, len(distance_m))[known],
            columns.get("rssi_dbm", np.full(len(distance_m), np.nan)).astype(float)[known],
            _links(words, known),
        )
    except (TypeError, ValueError) as error:
        raise FlightLogError(f"{place}: {error}") from error
    if not log.packets:
        raise FlightLogError(f"{place}: no rows")
    return log


class _Words(NamedTuple):
    """A column of words, of which there are few: the place of each row's among the names."""

    places: NDArray[np.integer[Any]]
    names: tuple[Any, ...]

    @classmethod
    def of(cls, column: NDArray[Any], place: str) -> _Words:
        import pyarrow as pa

        try:
            encoded = pa.array(column).dictionary_encode(null_encoding="encode")
        except pa.ArrowException as error:
            raise FlightLogError(f"{place}: has to be a text in every row") from error
        return cls(np.asarray(encoded.indices), tuple(encoded.dictionary.to_pylist()))

    def where(self, *words: str) -> NDArray[np.bool_]:
        """Return which rows have one of some words."""
        chosen: NDArray[np.bool_] = np.array([str(name) in words for name in self.names], dtype=bool)
        return np.asarray(chosen[self.places], dtype=np.bool_)


def _on_the_air(
    words: Mapping[str, _Words], distance_m: NDArray[np.float64], delivered: NDArray[Any]
) -> NDArray[np.bool_]:
    """Return which rows are packets that the radio sent between known places."""
    known = np.ones(len(distance_m), dtype=bool)
    if "fate" in words:
        known &= ~np.isnan(distance_m) | (delivered != 0)
        known &= ~words["fate"].where(*BEFORE_THE_RADIO)
    if "rx" in words:
        known &= ~words["rx"].where(ALL_RECEIVERS)
    return known


def _links(words: Mapping[str, _Words], known: NDArray[np.bool_]) -> NDArray[np.intp]:
    if not {"tx", "rx"} <= words.keys():
        return np.zeros(int(np.count_nonzero(known)), dtype=np.intp)
    ends = [[str(name) for name in words[end].names] for end in ("tx", "rx")]
    number = {name: i for i, name in enumerate(sorted({*ends[0], *ends[1]}))}
    tx, rx = (
        np.array([number[name] for name in names], dtype=np.intp)[words[end].places[known]]
        for end, names in zip(("tx", "rx"), ends, strict=True)
    )
    return links_of(tx, rx)


def _lengths(columns: Mapping[str, NDArray[Any]], base: RadioConfig, packets: int) -> NDArray[np.float64]:
    if "length_bytes" in columns and base.length.model != "fixed":
        return columns["length_bytes"].astype(np.float64)
    return np.full(packets, float(base.length.length_bytes(base.nominal_payload_bytes)))
