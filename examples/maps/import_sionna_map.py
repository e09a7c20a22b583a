"""Turn what Sionna RT computed into a gain map for a radio.

Run: ``python examples/maps/import_sionna_map.py ARRAYS.npz MAP.nc``. Save the arrays where Sionna RT
runs (tried with 2.2), one radio map per height above ground:

    scene = load_scene(sionna.rt.scene.munich)
    scene.frequency = 2.412e9
    scene.tx_array = PlanarArray(num_rows=1, num_cols=1, vertical_spacing=0.5, horizontal_spacing=0.5, pattern="iso",
                                 polarization="V")
    scene.rx_array = scene.tx_array
    scene.add(Transmitter(name="mast", position=[8.5, 21.0, 27.0]))
    maps = [RadioMapSolver()(scene, center=[0, 0, h], orientation=[0, 0, 0], size=[800, 800], cell_size=[10, 10],
                             samples_per_tx=10**7, max_depth=5) for h in (10.0, 40.0, 80.0)]
    np.savez("arrays.npz",
             path_gain=np.stack([m.path_gain.numpy() for m in maps]),         # heights, transmitters, cells y, cells x
             cell_centers=np.stack([m.cell_centers.numpy() for m in maps]),   # heights, cells y, cells x, 3
             tx_positions=np.stack([t.position.numpy().ravel() for t in scene.transmitters.values()]),
             frequency_hz=float(scene.frequency[0]))

Sionna's x is taken as east, y as north, z as height; `--origin X Y Z` is the place of the run's origin in its frame.
Gains are those of an isotropic transmitter ("iso") to an isotropic receiver: the radio adds its own antennas. Cells
that no ray reached have gain 0 there and no path (NaN) here.
"""

import argparse
from pathlib import Path

import h5py
import numpy as np


def gain_db(path_gain: np.ndarray) -> np.ndarray:
    """Return decibel from linear gains, NaN for none."""
    return 10.0 * np.log10(np.where(path_gain > 0.0, path_gain, np.nan))


def write_map(
    file: Path,
    path_gain: np.ndarray,
    cell_centers: np.ndarray,
    tx_positions: np.ndarray,
    frequency_hz: float,
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> None:
    """Write arrays of Sionna RT as a map.

    Args:
        file: NetCDF-4, or HDF5, which is the same here.
        path_gain: linear, shape (heights, transmitters, cells y, cells x).
        cell_centers: shape (heights, cells y, cells x, 3), an upright grid.
        tx_positions: shape (transmitters, 3).
        frequency_hz: carrier.
        origin: of the run, in the scene's frame.
    """
    centers = cell_centers - np.asarray(origin)
    transmitters = tx_positions - np.asarray(origin)
    columns = {
        "tx_north_m": transmitters[:, 1],
        "tx_east_m": transmitters[:, 0],
        "tx_height_m": transmitters[:, 2],
        "rx_height_m": centers[:, 0, 0, 2],
        "rx_north_m": centers[0, :, 0, 1],
        "rx_east_m": centers[0, 0, :, 0],
        "gain_db": gain_db(np.swapaxes(path_gain, 0, 1)).astype(np.float32),
    }
    with h5py.File(file, "w") as data:
        data.attrs["frequency_hz"] = frequency_hz
        for name, values in columns.items():
            data.create_dataset(name, data=values)


def main() -> None:
    """Read the arrays, write the map."""
    parser = argparse.ArgumentParser(description="Turn what Sionna RT computed into a gain map for a radio.")
    parser.add_argument("arrays", type=Path)
    parser.add_argument("map", type=Path)
    parser.add_argument("--origin", type=float, nargs=3, default=(0.0, 0.0, 0.0), metavar=("X", "Y", "Z"))
    given = parser.parse_args()
    with np.load(given.arrays) as data:
        arrays = {name: data[name] for name in ("path_gain", "cell_centers", "tx_positions")}
        frequency_hz = float(data["frequency_hz"])
    write_map(given.map, **arrays, frequency_hz=frequency_hz, origin=tuple(given.origin))


if __name__ == "__main__":
    main()
