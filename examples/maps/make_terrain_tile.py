"""Make the small terrain tile of the tests, ``tests/data/ridge.tif``: a ridge north of the scenarios' origin.

Run from the project's directory: ``python examples/maps/make_terrain_tile.py [FILE]``; needs `pip install
'lostlink[terrain]'`. A GeoTIFF of whole metres like an SRTM tile: 121 by 121 points, one second of arc apart, about
3.7 km by 2.9 km. A radio takes it with

    propagation: {model: terrain, file: ridge.tif, extent_m: 1200}
"""

import sys
from pathlib import Path

import numpy as np
import rasterio

FILE = Path("tests/data/ridge.tif")
LAT_DEG, LON_DEG, ALT_M = 40.1331, -105.2404, 1690.0
POINTS = 121
STEP_DEG = 1.0 / 3600.0


def height_m(lat_deg: np.ndarray, lon_deg: np.ndarray) -> np.ndarray:
    """Return a slope that rises to the west, with a ridge of 60 m across it 400 m north of the origin."""
    north = (lat_deg - LAT_DEG) * 111_319.5
    east = (lon_deg - LON_DEG) * 111_319.5 * np.cos(np.radians(LAT_DEG))
    return ALT_M - 0.02 * east + 60.0 * np.exp(-(((north - 400.0) / 80.0) ** 2))


def write(file: Path) -> None:
    """Write the tile, WGS 84, its first row in the north."""
    half = POINTS // 2
    west, north = LON_DEG - (half + 0.5) * STEP_DEG, LAT_DEG + (half + 0.5) * STEP_DEG
    lat, lon = np.meshgrid(
        LAT_DEG - (np.arange(POINTS) - half) * STEP_DEG,
        LON_DEG + (np.arange(POINTS) - half) * STEP_DEG,
        indexing="ij",
    )
    shape = {"width": POINTS, "height": POINTS, "count": 1, "dtype": "int16"}
    place = {"crs": "EPSG:4326", "transform": rasterio.Affine(STEP_DEG, 0.0, west, 0.0, -STEP_DEG, north)}
    with rasterio.open(file, "w", driver="GTiff", compress="deflate", predictor=2, **shape, **place) as data:
        data.write(np.round(height_m(lat, lon)).astype("int16"), 1)


if __name__ == "__main__":
    write(Path(sys.argv[1]) if len(sys.argv) > 1 else FILE)
