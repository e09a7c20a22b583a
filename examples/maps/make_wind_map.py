"""Make the wind map that ships, ``sitl_configs/wind/shear.nc``, and a plot of it.

Run from the project's directory: ``python examples/maps/make_wind_map.py``. A field of 2 km by 2 km around the map's
origin, 300 m high, over ten minutes: the west wind grows with height (a log profile over grass) and from south to
north, and turns to south-west as time goes on; a thermal rises over the middle.
"""

import math
from pathlib import Path

import numpy as np
from scipy.io import netcdf_file

DIRECTORY = Path("sitl_configs/wind")
ORIGIN = (47.3977, 8.5456, 488.0)
ROUGHNESS_M = 0.03
SPEED_10M_MPS = 4.0


def field() -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Axes (time s, altitude m, y m, x m) and wind components (m/s)."""
    axes = {
        "time": np.array([0.0, 300.0, 600.0]),
        "altitude": ORIGIN[2] + np.array([0.0, 5.0, 10.0, 20.0, 40.0, 80.0, 150.0, 300.0]),
        "y": np.linspace(-1000.0, 1000.0, 9),
        "x": np.linspace(-1000.0, 1000.0, 9),
    }
    time, altitude, y, x = np.meshgrid(*axes.values(), indexing="ij")
    height = np.maximum(altitude - ORIGIN[2], ROUGHNESS_M)
    profile = np.log(height / ROUGHNESS_M) / math.log(10.0 / ROUGHNESS_M)
    speed = SPEED_10M_MPS * profile * (1.0 + 0.5 * y / 1000.0)
    towards = np.radians(90.0 - 45.0 * time / 600.0)
    thermal = 2.0 * np.exp(-(x**2 + y**2) / 400.0**2) * np.minimum(height / 100.0, 1.0)
    return axes, {"u": speed * np.sin(towards), "v": speed * np.cos(towards), "w": thermal}


def write(path: Path) -> None:
    """Write the map as NetCDF (classic), after the CF conventions."""
    axes, components = field()
    units = {"time": "s", "altitude": "m", "y": "m", "x": "m"}
    names = {"u": "eastward_wind", "v": "northward_wind", "w": "upward_air_velocity"}
    with netcdf_file(path, "w") as file:
        file.Conventions = "CF-1.10"
        file.title = "Sheared west wind over grass with a thermal, made by examples/maps/make_wind_map.py"
        file.origin_latitude, file.origin_longitude = ORIGIN[:2]
        for name, values in axes.items():
            file.createDimension(name, len(values))
            variable = file.createVariable(name, "d", (name,))
            variable[:] = values
            variable.units = units[name]
        for name, values in components.items():
            variable = file.createVariable(name, "f", tuple(axes))
            variable[:] = values
            variable.standard_name, variable.units = names[name], "m s-1"


def plot(path: Path) -> None:
    """Draw the profile over the origin and the wind at 40 m at the start."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    axes, wind = field()
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 4), constrained_layout=True)
    left.plot(wind["u"][0, :, 4, 4], axes["altitude"] - ORIGIN[2], marker="o")
    left.set(xlabel="eastward wind over the origin, m/s", ylabel="height, m")
    rising = right.contourf(axes["x"], axes["y"], wind["w"][0, 4], cmap="Reds")
    right.quiver(axes["x"], axes["y"], wind["u"][0, 4], wind["v"][0, 4])
    right.set(xlabel="east, m", ylabel="north, m", title="40 m above the ground, t = 0", aspect="equal")
    figure.colorbar(rising, label="upward, m/s")
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    write(DIRECTORY / "shear.nc")
    Path("docs/img").mkdir(exist_ok=True)
    plot(Path("docs/img/wind-shear.png"))
