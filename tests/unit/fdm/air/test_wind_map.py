import itertools
import math
import os
import signal
import subprocess
import sys

import h5py
import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator
from scipy.io import netcdf_file

from fdm.air.wind import WINDS_DIR, WindConfig
from fdm.air.wind_map import WindMap, load_wind_map
from fdm.errors import WindError
from fdm.model.air_point import AirPoint
from fdm.model.geodesy import GeodeticPosition, geodetic_from_ned
from sitl_configs import netcdf

ORIGIN = GeodeticPosition(47.0, 8.0, 400.0)
AXES = {
    "time": [0.0, 60.0, 180.0],
    "altitude": [400.0, 420.0, 500.0],
    "y": [-300.0, 0.0, 100.0, 400.0],
    "x": [-200.0, 0.0, 300.0],
}
UNITS = {"time": "s", "altitude": "m", "y": "m", "x": "m"}
NAMES = {"u": "eastward_wind", "v": "northward_wind", "w": "upward_air_velocity"}


SECONDS = itertools.count(1_700_000_000)


def changed(path):
    """Gives a file that was written a time of its own: two writes may be within one step of the system's clock."""
    second = next(SECONDS)
    os.utime(path, (second, second))


class Classic:
    """Writes NetCDF classic."""

    def __init__(self, path):
        self.file = netcdf_file(path, "w")

    def attribute(self, name, value):
        setattr(self.file, name, value)

    def variable(self, name, dimensions, values, attributes):
        for dimension, length in zip(dimensions, np.shape(values), strict=True):
            if dimension not in self.file.dimensions:
                self.file.createDimension(dimension, length)
        values = np.asarray(values)
        variable = self.file.createVariable(name, values.dtype, dimensions)
        variable[:] = values
        for key, value in attributes.items():
            setattr(variable, key, value)

    def close(self):
        self.file.close()


class Four:
    """Writes NetCDF-4: HDF5 with dimension scales."""

    def __init__(self, path):
        self.file = h5py.File(path, "w")

    def attribute(self, name, value):
        self.file.attrs[name] = value

    def variable(self, name, dimensions, values, attributes):
        variable = self.file.create_dataset(name, data=np.asarray(values))
        if dimensions == (name,):
            variable.make_scale(name)
        else:
            for index, dimension in enumerate(dimensions):
                variable.dims[index].attach_scale(self.file[dimension])
        for key, value in attributes.items():
            variable.attrs[key] = value

    def close(self):
        self.file.close()


@pytest.fixture
def in_process(monkeypatch):
    """Read NetCDF-4 in this process: half a second less per file."""
    monkeypatch.setattr(netcdf, "_read_netcdf4", netcdf._read_hdf5)


@pytest.fixture(params=[Classic, Four])
def write_map(request, tmp_path):
    """Writes a random map; changes replace axes, attributes (by variable), or drop them (None)."""

    def write(*, axes=None, attributes=None, origin=True, order=None, change=None, drop=()):
        coordinates = {name: values for name, values in (AXES | (axes or {})).items() if values is not None}
        order = order or tuple(coordinates)
        shape = tuple(len(coordinates[name]) for name in order)
        rng = np.random.default_rng(5)
        path = tmp_path / "map.nc"
        file = request.param(path)
        if origin:
            file.attribute("origin_latitude", 47.0)
            file.attribute("origin_longitude", 8.0)
        for name, values in coordinates.items():
            file.variable(
                name,
                (name,),
                np.array(values),
                {"units": UNITS.get(name, "1")} | (attributes or {}).get(name, {}),
            )
        for name, standard_name in NAMES.items():
            if name in drop:
                continue
            values = rng.normal(0.0, 5.0, shape)
            if change is not None:
                values = change(name, values)
            own = {"standard_name": standard_name, "units": "m s-1"} | (attributes or {}).get(name, {})
            file.variable(name, order, values, own)
        file.close()
        changed(path)
        return path

    return write


def at(time_s=0.0, ned_m=(0.0, 0.0, -50.0)):
    place = geodetic_from_ned(ORIGIN, ned_m)
    return AirPoint(
        round(time_s * 1e9), place.lat_deg, place.lon_deg, place.alt_amsl_m, -ned_m[2], (15.0, 0.0, 0.0)
    )


def wind_of(path, **settings):
    return WindConfig.model_validate({"map": {"file": str(path), **settings}}).build(seed=1, ua_id=0)


def test_a_map_is_exact_at_its_points(write_map):
    wind_map = load_wind_map(write_map())
    rng = np.random.default_rng(5)
    east, north, up = (rng.normal(0.0, 5.0, (3, 3, 4, 3)) for _ in range(3))
    for index in np.ndindex(3, 3, 4, 3):
        where = tuple(axis[i] for axis, i in zip(AXES.values(), index, strict=True))
        expected = (north[index], east[index], -up[index])
        assert wind_map.interpolate(where, clamp=False) == pytest.approx(expected, abs=1e-12)


def test_a_map_is_read_once_and_anew_when_it_was_written_anew(write_map):
    path = write_map()
    first = load_wind_map(path)
    assert load_wind_map(path) is first
    assert write_map(change=lambda _, values: values + 1.0) == path
    assert component(load_wind_map(path), "u") == pytest.approx(component(first, "u") + 1.0)


def test_a_map_interpolates_as_scipy_does(write_map):
    wind_map = load_wind_map(write_map())
    rng = np.random.default_rng(5)
    east, north, up = (rng.normal(0.0, 5.0, (3, 3, 4, 3)) for _ in range(3))
    oracle = RegularGridInterpolator(tuple(AXES.values()), np.stack([north, east, -up], axis=-1))
    lows, highs = zip(*((axis[0], axis[-1]) for axis in AXES.values()), strict=True)
    for where in np.random.default_rng(6).uniform(lows, highs, (200, 4)):
        got = wind_map.interpolate(tuple(where.tolist()), clamp=False)
        assert got == pytest.approx(oracle(where)[0], abs=1e-9)


def test_only_the_cell_around_the_place_is_touched():
    # 24 petabytes, were it not one vector repeated.
    length = 100_000
    axis = tuple(float(value) for value in range(length))
    ned_mps = np.broadcast_to(np.array([1.0, 2.0, 3.0]), (2, length, length, length, 3))
    wind_map = WindMap("vast", ((0.0, 60.0), axis, axis, axis), ORIGIN, ned_mps)
    assert wind_map.interpolate((30.0, 500.5, 1e9, -7.0), clamp=True) == (1.0, 2.0, 3.0)


def test_outside_a_map_it_is_clamped_or_an_error(write_map):
    path = write_map()
    clamped, strict = wind_of(path), wind_of(path, outside="error")
    inside, outside = at(0.0, (399.9, 0, -50)), at(0.0, (5000, 0, -50))
    assert clamped.air_ned_mps(outside) == pytest.approx(strict.air_ned_mps(inside), abs=0.05)
    with pytest.raises(WindError, match=r"y 5000 is outside the map \(-300 to 400\)"):
        strict.air_ned_mps(outside)


DEGREES = {"y": {"units": "degrees_north"}, "x": {"units": "degrees_east"}}


@pytest.mark.parametrize("east_deg", [[7.9, 8.0, 8.1], [-352.1, -352.0, -351.9], [367.9, 368.0, 368.1]])
@pytest.mark.usefixtures("in_process")
def test_a_map_in_degrees_is_read_at_latitude_and_longitude(write_map, east_deg):
    path = write_map(axes={"y": [46.9, 47.0, 47.1, 47.2], "x": east_deg}, attributes=DEGREES, origin=False)
    wind_map = load_wind_map(path)
    expected = tuple(wind_map.ned_mps[0, 1, 1, 1])
    assert wind_of(path).air_ned_mps(at(0.0, (0, 0, -20))) == pytest.approx(expected, abs=1e-7)


@pytest.mark.parametrize("first_deg", [0.0, -180.0, 5.0, -4.37, 38.7])
@pytest.mark.usefixtures("in_process")
def test_a_map_around_the_earth_has_no_seam(write_map, first_deg):
    east_deg = [first_deg + 60.0 * k for k in range(6)]
    path = write_map(axes={"y": [-90.0, 0.0, 90.0], "x": east_deg}, attributes=DEGREES, origin=False)
    last, first = (load_wind_map(path).ned_mps[0, 1, 1, k] for k in (5, 0))
    strict = wind_of(path, outside="error")
    for share in (0.0, 0.25, 1.0):
        point = at(0.0)._replace(alt_amsl_m=420.0, lat_deg=0.0, lon_deg=east_deg[5] + 60.0 * share)
        for turns in (-360.0, 0.0, 360.0):
            felt = strict.air_ned_mps(point._replace(lon_deg=point.lon_deg + turns))
            assert felt == pytest.approx(tuple((1 - share) * last + share * first), abs=1e-9)


@pytest.mark.usefixtures("in_process")
def test_a_map_of_part_of_the_earth_keeps_its_edges(write_map):
    path = write_map(
        axes={"y": [-90.0, 0.0, 90.00001], "x": [5.0, 6.0, 7.0, 200.0]}, attributes=DEGREES, origin=False
    )
    assert load_wind_map(path).axes[3][-1] == 200.0
    with pytest.raises(WindError, match="outside the map"):
        wind_of(path, outside="error").air_ned_mps(
            at(0.0)._replace(alt_amsl_m=420.0, lat_deg=0.0, lon_deg=-100.0)
        )


@pytest.mark.usefixtures("in_process")
def test_axes_may_decrease(write_map):
    rising = load_wind_map(write_map())
    falling = write_map(
        axes={"altitude": AXES["altitude"][::-1], "y": AXES["y"][::-1]},
        change=lambda _, values: values.reshape(3, 3, 4, 3)[:, ::-1, ::-1, :],
    )
    assert load_wind_map(falling).axes == rising.axes
    assert np.array_equal(load_wind_map(falling).ned_mps, rising.ned_mps)


@pytest.mark.usefixtures("in_process")
def test_axes_may_come_in_another_order_and_under_other_names(write_map):
    rising = load_wind_map(write_map())
    axes = dict.fromkeys(AXES) | {
        "lon": AXES["x"],
        "t": AXES["time"],
        "lat": AXES["y"],
        "z": AXES["altitude"],
    }
    attributes = {
        "lon": {"axis": "X", "units": "m"},
        "t": {"standard_name": "time", "units": "s"},
        "lat": {"standard_name": "projection_y_coordinate", "units": "m"},
        "z": {"axis": "Z", "positive": "up", "units": "m"},
    }
    other = write_map(
        axes=axes,
        attributes=attributes,
        order=("lon", "t", "lat", "z"),
        change=lambda name, _: np.transpose(component(rising, name), (3, 0, 2, 1)),
    )
    assert load_wind_map(other).axes == rising.axes
    assert np.array_equal(load_wind_map(other).ned_mps, rising.ned_mps)


def component(wind_map, name):
    sign, index = {"u": (1, 1), "v": (1, 0), "w": (-1, 2)}[name]
    return sign * wind_map.ned_mps[..., index]


@pytest.mark.usefixtures("in_process")
def test_units_are_converted(write_map):
    plain = load_wind_map(write_map())
    path = write_map(
        attributes={
            "time": {"units": "minutes since 2026-05-01 06:00"},
            "altitude": {"units": "ft"},
            "y": {"units": "km"},
            "u": {"units": "km h-1"},
            "v": {"units": "knots"},
        },
    )
    wind_map = load_wind_map(path)
    assert wind_map.axes[0] == (0.0, 3600.0, 10800.0)
    assert wind_map.axes[1] == pytest.approx([0.3048 * value for value in AXES["altitude"]])
    assert wind_map.axes[2] == pytest.approx([1000 * value for value in AXES["y"]])
    assert component(wind_map, "u") == pytest.approx(component(plain, "u") / 3.6)
    assert component(wind_map, "v") == pytest.approx(component(plain, "v") * 1852 / 3600)


@pytest.mark.usefixtures("in_process")
def test_the_first_time_of_a_dated_map_is_the_start(write_map):
    path = write_map(
        axes={"time": [30.0, 31.0, 33.0]}, attributes={"time": {"units": "hours since 2026-05-01"}}
    )
    assert load_wind_map(path).axes[0] == (0.0, 3600.0, 10800.0)


@pytest.mark.usefixtures("in_process")
def test_packed_values_are_unpacked(write_map):
    path = write_map(
        attributes={"u": {"scale_factor": 0.01, "add_offset": 2.0}},
        change=lambda name, values: np.full(values.shape, 150, np.int16) if name == "u" else values,
    )
    assert component(load_wind_map(path), "u") == pytest.approx(3.5)


@pytest.mark.usefixtures("in_process")
def test_what_is_missing_is_everywhere_and_still(write_map):
    path = write_map(axes={"time": None, "altitude": [0.0]}, drop=("w",))
    wind_map = load_wind_map(path)
    assert wind_map.ned_mps.shape == (1, 1, 4, 3, 3)
    assert not wind_map.ned_mps[..., 2].any()
    expected = wind_map.ned_mps[0, 0, 1, 1]
    assert wind_of(path, outside="error").air_ned_mps(at(1e5, (0, 0, -900))) == pytest.approx(
        expected, abs=1e-9
    )


def with_hole(name, values, hole=-999.0):
    return (
        np.where(np.arange(values.size).reshape(values.shape) == 7, hole, values) if name == "v" else values
    )


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"attributes": {"x": {"units": "degrees_east"}}}, "needed are degrees or metres, both"),
        ({"axes": {"x": [0.0, 0.0, 1.0]}}, "variable x: neither increases nor decreases"),
        ({"axes": {"x": [0.0, 2.0, 1.0]}}, "variable x: neither increases nor decreases"),
        ({"origin": False}, "origin_latitude and origin_longitude have to say"),
        ({"drop": ("u",)}, "no variable has the standard_name eastward_wind"),
        ({"attributes": {"u": {"units": "mph"}}}, "variable u: attribute units is 'mph': known are m s-1"),
        (
            {"attributes": {"time": {"units": "months since 2020-01-01"}}},
            "variable time: attribute units is 'months",
        ),
        ({"attributes": {"altitude": {"units": "Pa"}}}, "variable altitude: attribute units is 'Pa'"),
        (
            {"attributes": {"altitude": {"positive": "down"}}},
            "variable altitude: attribute positive is 'down'",
        ),
        ({"attributes": {"altitude": {"standard_name": "height"}}}, "'height', above the ground"),
        ({"attributes": {"w": {"standard_name": "eastward_wind"}}}, "w: u has the same standard_name"),
        ({"attributes": {"x": {"axis": "Y"}}}, "variable x: is a second axis for y; the first is y"),
        (
            {"attributes": {"v": {"_FillValue": -999.0}}, "change": with_hole},
            "variable v: has 1 values that are missing",
        ),
        (
            {"attributes": {"v": {"missing_value": -999.0}}, "change": with_hole},
            "v: has 1 values that are missing",
        ),
        (
            {"attributes": {"v": {"missing_value": np.array([-99.0, -999.0])}}, "change": with_hole},
            "v: has 1 values that are missing",
        ),
        (
            {
                "attributes": {"v": {"missing_value": -99.9}},
                "change": lambda n, v: with_hole(n, v, -99.9).astype("f4"),
            },
            "v: has 1 values that are missing",
        ),
        (
            {
                "axes": {"y": [46.0, 90.001]},
                "attributes": {"y": {"units": "degrees_north"}, "x": {"units": "degrees_east"}},
            },
            r"variable y: goes from 46 to 90\.001: latitudes are within 90",
        ),
        ({"change": lambda n, v: v * np.nan}, r"variable \w: has 108 values that are missing or not finite"),
        ({"axes": {"member": [0.0, 1.0]}}, "variable member: is no axis of a wind map"),
        (
            {"attributes": {"u": {"scale_factor": "two"}}},
            "u: attribute scale_factor or add_offset is no number",
        ),
        (
            {"attributes": {"u": {"scale_factor": math.nan}}},
            "variable u: has a wind of nan m/s, more than 200",
        ),
        (
            {"change": lambda name, values: np.full_like(values, 9.96921e36) if name == "v" else values},
            r"variable v: has a wind of 9\.96921e\+36 m/s, more than 200: see its units, _FillValue",
        ),
    ],
)
@pytest.mark.usefixtures("in_process")
def test_a_map_that_is_none_is_explained(write_map, changes, message):
    with pytest.raises(WindError, match=rf"map\.nc: .*{message}"):
        load_wind_map(write_map(**changes))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is no NetCDF file"),
        (b"PK\x03\x04 a zip", "is no NetCDF file: it begins with"),
        (b"\x89HDF\r\n\x1a\n", "is broken"),
        (b"CDF\x01", "is broken"),
        (b"CDF\x05" + bytes(40), "CDF-5 format; convert it with nccopy -k nc4"),
    ],
)
def test_a_file_that_is_no_map_is_explained(tmp_path, content, message):
    path = tmp_path / "map.nc"
    with pytest.raises(WindError, match="No such file"):
        load_wind_map(path)
    path.write_bytes(content)
    with pytest.raises(WindError, match=message):
        load_wind_map(path)


def broken(good, rng, count):
    """Truncated and mutated copies of a file's bytes."""
    for number in range(count):
        content = bytearray(good)
        if number % 3 == 0:
            del content[rng.integers(8, len(content)) :]
        else:
            for place in rng.integers(8, len(content), size=rng.choice([1, 3, 10, 100])):
                content[place] = rng.integers(256)
        yield bytes(content)


def test_broken_files_are_refused_and_nothing_worse(write_map):
    path = write_map()
    good = path.read_bytes()
    told = set()
    # NetCDF-4 is read in a process of its own, half a second each.
    for content in broken(good, np.random.default_rng(11), 300 if good.startswith(b"CDF") else 9):
        path.write_bytes(content)
        changed(path)
        try:
            load_wind_map(path)
        except WindError as error:
            told.add(str(error).removeprefix(f"{path}: ").split(":")[0])
    assert "is broken" in told


@pytest.mark.parametrize(
    ("code", "timeout_s", "message"),
    [
        ("import time; time.sleep(60)", 0.5, r"is broken: HDF5 did not end with it in 0\.5 s"),
        (
            "import os, signal; os.kill(os.getpid(), signal.SIGSEGV)",
            60.0,
            r"is broken: HDF5 crashed on it \(-11\)",
        ),
    ],
)
def test_a_file_that_hdf5_loops_over_or_crashes_on_is_explained(
    tmp_path, monkeypatch, code, timeout_s, message
):
    reader = tmp_path / "python"
    reader.write_text(f'#!/bin/sh\nexec "{sys.executable}" -c "{code}"\n')
    reader.chmod(0o755)
    path = tmp_path / "map.nc"
    path.write_bytes(netcdf.HDF5)
    monkeypatch.setattr(netcdf.sys, "executable", str(reader))
    monkeypatch.setattr(netcdf, "READ_TIMEOUT_S", timeout_s)
    with pytest.raises(WindError, match=message):
        load_wind_map(path)


def test_the_reader_of_hdf5_ends_though_nobody_waits_for_it_any_more():
    code = (
        "from pathlib import Path\n"
        "from sitl_configs import netcdf\n"
        "def loop(path, wanted):\n"
        "    while True:\n"
        "        pass\n"
        "netcdf._read_hdf5, netcdf.READ_TIMEOUT_S = loop, 1.0\n"
        "netcdf.main(Path('map.nc'), [])\n"
    )
    done = subprocess.run([sys.executable, "-c", code], timeout=60, check=False)
    assert done.returncode == -signal.SIGXCPU


@pytest.mark.usefixtures("in_process")
def test_a_small_file_that_says_it_is_vast_is_not_unpacked(tmp_path, monkeypatch):
    monkeypatch.setattr(netcdf, "FILE_MAX_BYTES", 1_000_000)
    path = tmp_path / "map.nc"
    with h5py.File(path, "w") as file:
        file.create_dataset("x", shape=(1_000_000,), dtype="f8", chunks=(1000,)).make_scale("x")
    with pytest.raises(WindError, match=r"is broken: MemoryError: /x has 0\.008 GB, more than 0\.001"):
        load_wind_map(path)


def test_the_shipped_map_is_the_same_in_both_formats(tmp_path):
    shipped = load_wind_map(WINDS_DIR / "shear.nc")
    path = tmp_path / "four.nc"
    copy = Four(path)
    with netcdf_file(WINDS_DIR / "shear.nc", "r", mmap=False) as file:
        for name in ("origin_latitude", "origin_longitude"):
            copy.attribute(name, getattr(file, name))
        for name, variable in sorted(file.variables.items(), key=lambda item: len(item[1].dimensions)):
            attributes = {key: value.decode() for key, value in variable._attributes.items()}
            copy.variable(name, variable.dimensions, np.array(variable[:], dtype="f8"), attributes)
    copy.close()
    other = load_wind_map(path)
    assert other.axes == shipped.axes
    assert np.array_equal(other.ned_mps, shipped.ned_mps)
