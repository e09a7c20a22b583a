"""Flight logs of deliveries, from CSV: what was sent at which distance, and whether it arrived."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from channel import checks
from channel.checks import ChannelInputError, FloatArray
from channel.config import RadioConfig
from channel.csv_rows import rows_with_headings
from channel.fit.cells import alike

EARTH_RADIUS_M = 6_371_008.8
POSITION_COLUMNS = tuple(f"{end}_{part}" for end in ("tx", "rx") for part in ("lat_deg", "lon_deg", "alt_m"))
LAT_MAX_DEG, LON_MAX_DEG = 90.0, 360.0
COLUMNS = (
    *("distance_m", "delivered", "fate", "length_bytes", "rssi_dbm", "tx", "rx", "radio", "attempts"),
    *POSITION_COLUMNS,
)
"""That are read, if they are there."""
TRUE = frozenset({"1", "true", "yes", "delivered"})
FALSE = frozenset({"0", "false", "no"})
NOTHING = frozenset({"", "nan", "none", "null", "-"})
MAX_LENGTH_BYTES = 1 << 24
BEFORE_THE_RADIO = frozenset({"transport", "too_long", "no_position", "radio_off", "partitioned"})
"""Fates in a run's deliveries of packets that the channel had nothing to do with."""
NO_OUTCOME = "has no column delivered (1 or 0), nor fate: which packets arrived has to be said"
ALL_RECEIVERS = "all"
"""In the column `rx` of a run's deliveries: packets that were lost together, in one row."""
MAIN = "main"
"""In their column `radio`: the network that has all nodes."""
OF_A_RUN = frozenset({"fate", "radio", "attempts"})
"""Columns by which a table is known for a run's deliveries."""


class FlightLogError(ValueError):
    """A log that cannot be read: the message names file, line and column."""


@dataclass(frozen=True, slots=True)
class FlightLog:
    """One row per packet; arrays of one length.

    Attributes:
        distance_m: between the ends, >= 0.
        delivered: whether it arrived.
        length_bytes: as the error model counts it.
        rssi_dbm: received power where it was measured, else NaN.
        link: number of the pair of ends that each packet went between: the shadowing of different pairs is independent.

    Raises:
        ChannelInputError: a value out of range, or arrays of another shape.
    """

    distance_m: FloatArray
    delivered: NDArray[np.bool_]
    length_bytes: FloatArray
    rssi_dbm: FloatArray
    link: NDArray[np.intp] = field(default_factory=lambda: np.zeros(0, dtype=np.intp))

    def __post_init__(self) -> None:
        distance = checks.finite("distance_m", self.distance_m, 0.0)
        length = checks.finite("length_bytes", self.length_bytes, 0.0, MAX_LENGTH_BYTES)
        delivered = checks.finite("delivered", self.delivered, 0.0, 1.0)
        neither = (delivered != 0.0) & (delivered != 1.0)
        if neither.any():
            raise ChannelInputError("delivered", float(delivered[neither].flat[0]), "0 or 1")
        rssi = np.asarray(self.rssi_dbm, dtype=np.float64)
        checks.finite("rssi_dbm", rssi[~np.isnan(rssi)])
        columns = {
            "distance_m": distance,
            "delivered": delivered.astype(bool),
            "length_bytes": length,
            "rssi_dbm": rssi,
            "link": np.asarray(self.link if np.size(self.link) else np.zeros(distance.size), dtype=np.intp),
        }
        for name, column in columns.items():
            if column.ndim != 1 or column.shape != distance.shape:
                raise ChannelInputError(
                    name,
                    f"array of shape {column.shape}",
                    f"one number per packet, as in distance_m {distance.shape}",
                )
            object.__setattr__(self, name, column)

    @property
    def packets(self) -> int:
        """How many packets the log has."""
        return int(self.distance_m.size)

    def part(self, chosen: NDArray[np.bool_]) -> FlightLog:
        """Return some of the packets."""
        return FlightLog(
            self.distance_m[chosen],
            self.delivered[chosen],
            self.length_bytes[chosen],
            self.rssi_dbm[chosen],
            self.link[chosen],
        )


def single_trials(radio: NDArray[Any], attempts: NDArray[Any], network: str, place: str) -> NDArray[np.bool_]:
    """Return which rows of a run's deliveries are of a radio network.

    Raises:
        FlightLogError: none, or some of packets that were on the air more than once.
    """
    mine = np.asarray(radio == network, dtype=np.bool_)
    if mine.size and not mine.any():
        there = ", ".join(sorted(set(radio.tolist())))
        raise FlightLogError(f"--network {network}: {place} has packets of {there}")
    again = int(np.count_nonzero(attempts[mine] > 1))
    if again:
        raise FlightLogError(
            f"{place}: {again} of {np.count_nonzero(mine)} packets of network {network} were on the air more than once "
            "(attempts): what became of them is no single trial of a radio"
        )
    return mine


def read_flight_log(file: Path, default_length_bytes: int, network: str = MAIN) -> FlightLog:
    """Read a CSV with a heading.

    Columns: `distance_m`, or tx_lat_deg, tx_lon_deg, tx_alt_m and the same for rx; `delivered` (1/0, true/false) or
    `fate` (delivered, or the cause of the loss, as in a run's deliveries); optional `length_bytes` and `rssi_dbm`
    (empty where there is none), `tx` and `rx` (which pair of ends). Others are left alone, and so are lost packets
    whose distance is not known, and those that never came to the radio. Of a run's deliveries those of one radio
    network are read (`single_trials`).

    Raises:
        FlightLogError: no such file, a missing column, a value that is none, or a run that cannot be fitted.
    """
    try:
        with file.open(encoding="utf-8-sig", newline="") as lines:
            headings, read = rows_with_headings(lines, COLUMNS)
            names = set(headings)
            if not names & {"delivered", "fate"}:
                raise FlightLogError(f"{file}: {NO_OUTCOME}")
            rows = [
                _row(row, names, default_length_bytes, f"{file}:{number}")
                for number, row in read
                if not _lost_nowhere(row)
            ]
    except OSError as error:
        raise FlightLogError(f"cannot read {file}: {error.strerror}") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise FlightLogError(f"{file}: cannot be read as a CSV: {error}") from error
    if not rows:
        raise FlightLogError(f"{file}: no rows")
    *columns, tx, rx, radio, attempts = (list(column) for column in zip(*rows, strict=True))
    distance, delivered, length, rssi = (np.asarray(column) for column in columns)
    link = links_of(*np.split(np.unique([*tx, *rx], return_inverse=True)[1], 2))
    log = FlightLog(
        distance.astype(float), delivered.astype(bool), length.astype(float), rssi.astype(float), link
    )
    if names >= OF_A_RUN:
        return log.part(single_trials(np.array(radio), np.array(attempts), network, str(file)))
    return log


def links_of(tx: NDArray[np.intp], rx: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return a number for each packet's pair of ends, the same one in both directions: shadowing is reciprocal.

    Args:
        tx: number of the end that sent it, in the order of their names.
        rx: likewise of the other.
    """
    return alike(np.minimum(tx, rx), np.maximum(tx, rx)).of_row


def read_csv_log(file: Path, base: RadioConfig, network: str = MAIN) -> FlightLog:
    """Return what `read_flight_log` returns, with the lengths as a radio counts them.

    A radio with a fixed length has it for every packet, and where the log has none the nominal one counts. The lengths
    of a log that has some are taken as they are: a run's deliveries have them as the error model counted them.
    """
    nominal = base.length.length_bytes(base.nominal_payload_bytes)
    log = read_flight_log(file, nominal, network)
    if base.length.model == "fixed":
        return replace(log, length_bytes=np.full(log.packets, float(nominal)))
    return log


def _row(
    row: Mapping[str, str | None], names: set[str], default_length: int, place: str
) -> tuple[float, bool, float, float, str, str, str, float]:
    if "distance_m" in names:
        distance = _number(row, "distance_m", place)
    elif names.issuperset(POSITION_COLUMNS):
        distance = _separation_m([_coordinate(row, name, place) for name in POSITION_COLUMNS])
    else:
        raise FlightLogError(f"{place}: needs distance_m, or {', '.join(POSITION_COLUMNS)}")
    if distance < 0.0:
        raise FlightLogError(f"{place}: distance_m = {distance:g}: has to be 0 or above")
    length = _number(row, "length_bytes", place) if row.get("length_bytes") else float(default_length)
    if not 0.0 <= length <= MAX_LENGTH_BYTES:
        raise FlightLogError(f"{place}: length_bytes = {length:g}: has to be from 0 to {MAX_LENGTH_BYTES}")
    has_rssi = (row.get("rssi_dbm") or "").strip().lower() not in NOTHING
    rssi = _number(row, "rssi_dbm", place) if has_rssi else float("nan")
    tx, rx, radio = (row.get(name) or "" for name in ("tx", "rx", "radio"))
    attempts = _number(row, "attempts", place) if names >= OF_A_RUN else 1.0
    return distance, _delivered(row, place), length, rssi, tx, rx, radio, attempts


def _lost_nowhere(row: Mapping[str, str | None]) -> bool:
    """Return whether a run's packet was lost with an end at no known place, or before it came to the radio."""
    if row.get("fate") in BEFORE_THE_RADIO or row.get("rx") == ALL_RECEIVERS:
        return True
    lost = row.get("fate") not in (None, "", "delivered")
    return lost and (row.get("distance_m") or "").strip().lower() == "nan"


def _delivered(row: Mapping[str, str | None], place: str) -> bool:
    if row.get("fate"):
        return row["fate"] == "delivered"
    text = (row.get("delivered") or "").strip().lower()
    with suppress(ValueError):  # 1.0 and 1e+00, as programs write a column of ones and zeros
        text = {1.0: "1", 0.0: "0"}.get(float(text), text)
    if text not in TRUE | FALSE:
        raise FlightLogError(f"{place}: delivered = {text!r}: allowed are 1, 0, true, false")
    return text in TRUE


def _number(row: Mapping[str, str | None], name: str, place: str) -> float:
    try:
        value = float(row[name] or "")
    except (ValueError, TypeError):
        value = float("nan")
    if not np.isfinite(value):
        raise FlightLogError(f"{place}: {name} = {row.get(name)!r}: has to be a number")
    return value


def _coordinate(row: Mapping[str, str | None], name: str, place: str) -> float:
    value = _number(row, name, place)
    most = LAT_MAX_DEG if "_lat_" in name else LON_MAX_DEG if "_lon_" in name else np.inf
    if abs(value) > most:
        raise FlightLogError(f"{place}: {name} = {value:g}: has to be from {-most:g} to {most:g}")
    return value


def _separation_m(places: list[float]) -> float:
    """Return the distance of two geodetic places on a sphere, good to 0.5 % over the ranges of a radio."""
    lat_1, lon_1, alt_1, lat_2, lon_2, alt_2 = places
    north = np.radians(lat_2 - lat_1) * EARTH_RADIUS_M
    east_deg = (lon_2 - lon_1 + 180.0) % 360.0 - 180.0
    east = np.radians(east_deg) * EARTH_RADIUS_M * np.cos(np.radians(0.5 * (lat_1 + lat_2)))
    return float(np.sqrt(north**2 + east**2 + (alt_2 - alt_1) ** 2))
