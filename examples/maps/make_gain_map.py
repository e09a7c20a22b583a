"""Make the gain map that ships, ``sitl_configs/maps/ridge.nc``: two transmitters before a ridge, by the terrain model.

Run from the project's directory: ``python examples/maps/make_gain_map.py [FILE]``. A field of 800 m by 200 m with a
ridge of 50 m across it, 350 m north of the origin. A radio takes the map with

    propagation: {model: gain-map, file: sitl_configs/maps/ridge.nc, outside: fallback}
"""

import sys
from pathlib import Path

import numpy as np
from scipy.io import netcdf_file

from channel import Radio, load_radio

FILE = Path("sitl_configs/maps/ridge.nc")
FREQUENCY_HZ = 2.412e9
TRANSMITTERS_M = np.array([[0.0, 0.0, 40.0], [0.0, 0.0, 2.0]])
"""North, east, height: a UA that holds over home, and a ground station."""
HEIGHT_M = np.array([2.0, 10.0, 20.0, 40.0, 60.0, 80.0])
NORTH_M, EAST_M = np.linspace(-100.0, 700.0, 33), np.linspace(-100.0, 100.0, 5)


def ridge() -> dict[str, object]:
    """Return the terrain: heights every 25 m, flat but for a ridge with a saddle in it."""
    north, east = np.meshgrid(np.arange(-200.0, 801.0, 25.0), np.arange(-200.0, 201.0, 25.0), indexing="ij")
    height = 50.0 * np.exp(-(((north - 350.0) / 60.0) ** 2)) * (1.0 - 0.3 * np.exp(-((east / 60.0) ** 2)))
    return {
        "model": "terrain",
        "origin_north_m": -200.0,
        "origin_east_m": -200.0,
        "spacing_m": 25.0,
        "step_m": 5.0,
        "heights_m": height.round(2).tolist(),
    }


def gains_db() -> np.ndarray:
    """Return gains, shape (transmitters, heights, norths, easts)."""
    radio = Radio(load_radio("perfect", {"frequency_hz": FREQUENCY_HZ, "propagation": ridge()}))
    height, north, east = np.meshgrid(HEIGHT_M, NORTH_M, EAST_M, indexing="ij")
    receivers = np.stack((north, east, -height), axis=-1).reshape(-1, 3)
    rows = []
    for place in TRANSMITTERS_M * (1.0, 1.0, -1.0):
        link = radio.link(position_tx_ned_m=place, position_rx_ned_m=receivers)
        rows.append(-link.path_loss_db.reshape(height.shape))
    return np.stack(rows)


def write(file: Path) -> None:
    """Write the map as classic NetCDF."""
    axes = {"rx_height_m": HEIGHT_M, "rx_north_m": NORTH_M, "rx_east_m": EAST_M}
    with netcdf_file(file, "w") as data:
        data.title = "Two transmitters before a ridge, made by examples/maps/make_gain_map.py"
        data.frequency_hz = FREQUENCY_HZ
        data.createDimension("transmitter", len(TRANSMITTERS_M))
        for k, name in enumerate(("tx_north_m", "tx_east_m", "tx_height_m")):
            data.createVariable(name, "d", ("transmitter",))[:] = TRANSMITTERS_M[:, k]
        for name, values in axes.items():
            data.createDimension(name, len(values))
            data.createVariable(name, "d", (name,))[:] = values
        gain = data.createVariable("gain_db", "f", ("transmitter", *axes))
        gain[:] = gains_db()
        gain.units = "dB"


if __name__ == "__main__":
    write(Path(sys.argv[1]) if len(sys.argv) > 1 else FILE)
