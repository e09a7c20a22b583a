"""Links along a range of values, and how far a radio reaches: tables for people and programs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np

from channel import presets
from channel.checks import ChannelInputError, FloatArray
from channel.cli.link_report import link_report
from channel.config import RadioConfig
from channel.link.radio import Radio

MAX_POINTS = 100_000
FARTHEST_M = 100_000.0
GRID_POINTS = 4000
ENDS = {
    "distance": "ground_distance_m",
    "frequency-hz": "frequency_hz",
    "height-tx": "height_tx_m",
    "height-rx": "height_rx_m",
    "length-bytes": "length_bytes",
}
COLUMNS = (
    "path_loss_db",
    "received_power_dbm",
    "noise_floor_dbm",
    "snr_db",
    "ber",
    "per",
    "probability_of_delivery",
)


def sweep_values(text: str) -> list[float]:
    """Return the values of `start:stop:step`, both ends inside.

    Raises:
        ChannelInputError: not three numbers, a step that does not lead from start to stop, or too many values.
    """
    try:
        start, stop, step = (float(part) for part in text.split(":"))
    except ValueError as error:
        raise ChannelInputError("sweep", text, "start:stop:step, as in 50:1000:10") from error
    if not np.all(np.isfinite([start, stop, step])) or step == 0.0 or (stop - start) / step < 0.0:
        raise ChannelInputError("sweep", text, "finite numbers and a step that leads from start to stop")
    count = int((stop - start) / step + 1e-9) + 1
    if count > MAX_POINTS:
        raise ChannelInputError("sweep", text, f"at most {MAX_POINTS} values")
    return [start + k * step for k in range(count)]


def sweep(
    radio: str, overrides: Mapping[str, Any], key: str, values: Iterable[float], ends: Mapping[str, Any]
) -> list[dict[str, float]]:
    """Return one row per value: the value under `key`, then path loss, powers, error rates and delivery.

    Args:
        radio: a preset's name or a YAML file.
        overrides: keys of the radio to set.
        key: distance, frequency-hz, height-tx, height-rx, length-bytes, or any dotted key of the radio.
        values: to go through.
        ends: what stays: ground_distance_m, length_bytes, frequency_hz, height_tx_m, height_rx_m.

    Raises:
        PresetError: no such radio, key or value.
        ChannelInputError: a value out of range.
    """
    rows = []
    fixed = presets.load_radio(radio, overrides)
    for value in values:
        given = dict(ends)
        config = fixed
        if key in ENDS:
            given[ENDS[key]] = int(value) if key == "length-bytes" else value
        else:
            override = presets.overrides_from_settings([f"{key}={value!r}"])
            config = presets.load_radio(radio, presets.merged(overrides, override))
        report = link_report(config, **given)
        rows.append({key: value, **{column: report[column] for column in COLUMNS}})
    return rows


class RadioReach(NamedTuple):
    """How far a radio reaches between ends at its default height; inf beyond 100 km, 0 if nowhere."""

    name: str
    description: str
    range_50_m: float
    range_90_m: float


def reach(config: RadioConfig) -> RadioReach:
    """Return the largest distances at which a radio delivers half, and nine tenths, of its packets."""
    radio = Radio(config)
    distance = np.geomspace(1.0, FARTHEST_M, GRID_POINTS)
    share = radio.expected_delivery(distance)
    return RadioReach(
        config.name, config.description, _last(distance, share, 0.5), _last(distance, share, 0.9)
    )


def _last(distance_m: FloatArray, share: FloatArray, level: float) -> float:
    enough = np.flatnonzero(share >= level)
    if not enough.size:
        return 0.0
    if enough[-1] == len(share) - 1:
        return float("inf")
    here = slice(enough[-1], enough[-1] + 2)
    (near, far), (more, less) = np.log(distance_m[here]), share[here]
    return float(np.exp(near + (far - near) * (more - level) / (more - less)))
