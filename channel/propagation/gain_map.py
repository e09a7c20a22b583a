"""Path loss from a map: made by ray tracing, by a terrain model, or measured."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path as FilePath
from typing import Annotated, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator

from channel.checks import ChannelInputError, FloatArray
from channel.geometry import Path
from channel.propagation.gain_file import GainTable, read_gain_file
from channel.propagation.path_loss import FreeSpace, LogDistance, PathLossModel
from channel.propagation.two_ray import TwoRay, TwoSlope
from channel.validity import OutsideValidityError

Fallback = Annotated[FreeSpace | LogDistance | TwoRay | TwoSlope, Field(discriminator="model")]
FREQUENCY_SHARE = 0.05
"""By which a map's carrier may differ from the link's."""
OUTSIDE_KEY = "`outside: fallback` goes on with `fallback`"


class GainMap(PathLossModel):
    """Mean gain between two places, from a file (see `gain_file`): linear in dB between the points of a grid.

    One end has to stand at a transmitter of the map, within `tolerance_m`; which one does not matter, as the way is
    the same in both directions. If both do, the two gains are averaged in dB. Gains are between isotropic antennas:
    the radio's are added. The map has ground and horizon in it.
    """

    needs_places: ClassVar[bool] = True
    has_earth: ClassVar[bool] = True
    model: Literal["gain-map"] = "gain-map"
    file: str = Field(description="NetCDF or CSV, as seen from the YAML file")
    tolerance_m: float = Field(default=5.0, gt=0.0, description="between a node and a place of the map")
    no_path_db: float = Field(default=-200.0, le=0.0, description="gain where the map has no path")
    outside: Literal["refuse", "fallback"] = Field(default="refuse", description="where the map ends")
    fallback: Fallback = Field(default_factory=FreeSpace, description="the law outside")

    @field_validator("file")
    @classmethod
    def _is_a_map(cls, file: str) -> str:
        read_gain_file(FilePath(file))
        return file

    @cached_property
    def _table(self) -> GainTable:
        return read_gain_file(FilePath(self.file))

    @cached_property
    def _gain_db(self) -> FloatArray:
        return np.where(np.isnan(self._table.gain_db), self.no_path_db, self._table.gain_db)

    @property
    def frequencies_hz(self) -> tuple[float, float] | None:
        """The carriers for which the map counts; None: all, as its file says nothing of them."""
        made_for = self._table.frequency_hz
        if made_for is None:
            return None
        return made_for * (1.0 - FREQUENCY_SHARE), made_for * (1.0 + FREQUENCY_SHARE)

    def path_loss_db(self, path: Path) -> FloatArray:
        """Return the loss, dB.

        Raises:
            OutsideValidityError: neither end stands at a transmitter with the other in the grid, or another carrier,
                and the model is to refuse.
        """
        if path.position_tx_ned_m is None or path.position_rx_ned_m is None:
            raise ChannelInputError(
                "position_tx_ned_m", None, "positions of both ends: a map lies under them"
            )
        start, end = np.broadcast_arrays(_places(path.position_tx_ned_m), _places(path.position_rx_ned_m))
        there, known_there = self._one_way(start, end)
        back, known_back = self._one_way(end, start)
        has_carrier = self._has_carrier(path.frequency_hz)
        known = (known_there | known_back) & has_carrier
        if self.outside == "refuse" and not known.all():
            if self.frequencies_hz is not None and not has_carrier.all():
                carrier_hz = float(np.broadcast_to(path.frequency_hz, has_carrier.shape)[~has_carrier][0])
                low_hz, high_hz = self.frequencies_hz
                allowed = f"{low_hz:g} to {high_hz:g}, the carriers of {self.file}; {OUTSIDE_KEY}"
                raise OutsideValidityError("frequency_hz", carrier_hz, allowed)
            first = np.argwhere(~known)[0]
            ends = start[tuple(first)].tolist(), end[tuple(first)].tolist()
            name = "place (north, east, height) of the two ends"
            raise OutsideValidityError(name, ends, f"within the map; {OUTSIDE_KEY}")
        gain_db = (np.where(known_there, there, 0.0) + np.where(known_back, back, 0.0)) / np.maximum(
            known_there.astype(np.float64) + known_back, 1.0
        )
        if known.all():
            return -gain_db
        return np.where(known, -gain_db, self.fallback.path_loss_db(path))

    def _has_carrier(self, frequency_hz: FloatArray | float) -> NDArray[np.bool_]:
        if self.frequencies_hz is None:
            return np.asarray(True)
        low_hz, high_hz = self.frequencies_hz
        return np.greater_equal(frequency_hz, low_hz) & np.less_equal(frequency_hz, high_hz)

    def _one_way(self, tx_m: FloatArray, rx_m: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Return gains in dB from transmitters of the map, and whether it has them."""
        table = self._table
        tx, at_tx = self._nearest(table.tx_m, tx_m)
        if table.grid is None:
            rx, at_rx = self._nearest(table.rx_m, rx_m)
            return self._gain_db[tx, rx], at_tx & at_rx
        north, east, height = np.moveaxis(rx_m, -1, 0)
        cells = [_cell(axis, at) for axis, at in zip(table.grid, (height, north, east), strict=True)]
        inside = cells[0][2] & cells[1][2] & cells[2][2]
        out = np.zeros(tx.shape)
        for corner in range(8):
            weight, place = np.ones(tx.shape), [tx]
            for k, (index, share, _) in enumerate(cells):
                upper = corner >> k & 1
                weight = weight * (share if upper else 1.0 - share)
                place.append(np.minimum(index + upper, len(table.grid[k]) - 1))
            out = out + weight * self._gain_db[tuple(place)]
        return out, at_tx & inside

    def _nearest(self, places_m: FloatArray, at_m: FloatArray) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
        """Return which of the places is nearest, and whether it is within the tolerance."""
        squares = np.sum(np.square(at_m[..., np.newaxis, :] - places_m), axis=-1)
        index = np.argmin(squares, axis=-1)
        return index, np.less_equal(np.min(squares, axis=-1), self.tolerance_m**2)


def _places(position_ned_m: FloatArray) -> FloatArray:
    """Return north, east and height."""
    return np.asarray(position_ned_m * np.array([1.0, 1.0, -1.0]))


def _cell(axis: FloatArray, at: FloatArray) -> tuple[NDArray[np.intp], FloatArray, NDArray[np.bool_]]:
    """Return the point of the axis below, the share of the way to the next, and whether the axis reaches there."""
    if len(axis) == 1:  # a map of one height holds for all
        return np.zeros(at.shape, dtype=np.intp), np.zeros(at.shape), np.ones(at.shape, dtype=bool)
    index = np.clip(np.searchsorted(axis, at, side="right") - 1, 0, len(axis) - 2)
    share = (at - axis[index]) / (axis[index + 1] - axis[index])
    return index, np.clip(share, 0.0, 1.0), (at >= axis[0]) & (at <= axis[-1])
