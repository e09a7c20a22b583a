"""Gain maps: what a file says is what a link has."""

import runpy
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
from scipy.io import netcdf_file

from channel.link.radio import Radio
from channel.medium.medium import Medium
from channel.presets import PresetError, load_radio
from channel.propagation.gain_file import GainFileError, read_gain_file
from channel.propagation.path_loss import friis_db
from channel.validity import OutsideValidityError
from sitl_configs import netcdf

ROOT = Path(__file__).parents[4]
NORTH, EAST, HEIGHT = np.array([0.0, 100.0, 200.0]), np.array([-50.0, 50.0]), np.array([10.0, 50.0])
TX = np.array([[0.0, 0.0, 20.0], [0.0, 40.0, 2.0]])
NO_NOISE = {"model": "fixed", "floor_dbm": -330.0}
"""So that every packet has a power: those that nobody could receive have none."""


APART = netcdf._read_netcdf4
"""Reads NetCDF-4 in a process of its own."""


@pytest.fixture(autouse=True)
def in_process(monkeypatch):
    """Read NetCDF-4 in this process: half a second less per file."""
    monkeypatch.setattr(netcdf, "_read_netcdf4", netcdf._read_hdf5)


def plane_db(tx, north, east, height):
    """Linear in each axis, so that interpolation between the points of a grid is exact."""
    return -80.0 - 5.0 * tx - 0.1 * north + 0.02 * east + 0.05 * height


def columns():
    tx, height, north, east = np.meshgrid(np.arange(2), HEIGHT, NORTH, EAST, indexing="ij")
    return {
        "tx_north_m": TX[:, 0],
        "tx_east_m": TX[:, 1],
        "tx_height_m": TX[:, 2],
        "rx_height_m": HEIGHT,
        "rx_north_m": NORTH,
        "rx_east_m": EAST,
        "gain_db": plane_db(tx, north, east, height),
    }


def write_hdf5(file, userblock_size=0, **changed):
    with h5py.File(file, "w", userblock_size=userblock_size) as data:
        data.attrs["frequency_hz"] = 2.412e9
        for name, values in (columns() | changed).items():
            if values is not None:
                data.create_dataset(name, data=values)


def write_classic(file):
    dimensions = {name: (name,) for name in ("rx_height_m", "rx_north_m", "rx_east_m")}
    dimensions |= dict.fromkeys(("tx_north_m", "tx_east_m", "tx_height_m"), ("tx",))
    dimensions["gain_db"] = ("tx", "rx_height_m", "rx_north_m", "rx_east_m")
    with netcdf_file(file, "w") as data:
        data.frequency_hz = 2.412e9
        for name, size in {"tx": 2, "rx_height_m": 2, "rx_north_m": 3, "rx_east_m": 2}.items():
            data.createDimension(name, size)
        for name, values in columns().items():
            data.createVariable(name, "d", dimensions[name])[:] = values


PACKED = {"scale_factor": 0.01, "add_offset": -100.0, "_FillValue": np.int16(-32768)}


def packed_db():
    """Hundredths of a dB above -100 dB, as 16 bits; the first one is missing."""
    numbers = np.rint((columns()["gain_db"] + 100.0) * 100.0).astype("i2")
    numbers[0, 0, 0, 0] = -32768
    return numbers


def write_packed_hdf5(file):
    write_hdf5(file, gain_db=packed_db())
    with h5py.File(file, "r+") as data:
        data["gain_db"].attrs.update(PACKED)


def write_packed_classic(file):
    write_classic(file)
    with netcdf_file(file, "a") as data:
        packed = data.createVariable("packed", "h", data.variables["gain_db"].dimensions)
        packed[:] = packed_db()
        for name, value in PACKED.items():
            setattr(packed, name, value)
        data.variables["gain_db"] = data.variables.pop("packed")


@pytest.mark.parametrize("write", [write_packed_hdf5, write_packed_classic])
def test_packed_numbers_are_unpacked(tmp_path, write):
    """By the conventions of netCDF; otherwise 16 bits of hundredths are gains of thousands of dB."""
    write(tmp_path / "packed.nc")
    found, wanted = read_gain_file(tmp_path / "packed.nc").gain_db, columns()["gain_db"].copy()
    wanted[0, 0, 0, 0] = np.nan
    assert found == pytest.approx(wanted, abs=0.00501, nan_ok=True)


def test_numbers_of_single_precision_may_be_declared_missing_in_double(tmp_path):
    gain_db = columns()["gain_db"].astype("f4")
    gain_db[1, 1, 1, 1] = -99.9
    write_hdf5(tmp_path / "map.nc4", gain_db=gain_db)
    with h5py.File(tmp_path / "map.nc4", "a") as file:
        file["gain_db"].attrs["missing_value"] = -99.9
    assert np.argwhere(np.isnan(read_gain_file(tmp_path / "map.nc4").gain_db)).tolist() == [[1, 1, 1, 1]]


def write_csv(file):
    rows = ["tx_north_m,tx_east_m,tx_height_m,rx_north_m,rx_east_m,rx_height_m,gain_db"]
    for k, tx in enumerate(TX):
        for north in NORTH:
            for east in EAST:
                for height in HEIGHT:
                    gain = plane_db(k, north, east, height)
                    rows.append(",".join(f"{value:.10g}" for value in (*tx, north, east, height, gain)))
    file.write_text("\n".join(rows[:1] + rows[:0:-1]) + "\n")


WRITERS = {"map.nc": write_classic, "map.nc4": write_hdf5, "map.csv": write_csv}


def radio(file, **more):
    return Radio(load_radio("perfect", {"propagation": {"model": "gain-map", "file": str(file), **more}}))


def gain_db(of, tx, rx):
    ends = {
        "position_tx_ned_m": np.multiply(tx, (1, 1, -1)),
        "position_rx_ned_m": np.multiply(rx, (1, 1, -1)),
    }
    return -of.link(**ends).path_loss_db


@pytest.mark.parametrize("name", WRITERS)
def test_between_the_points_and_both_ways(tmp_path, name):
    WRITERS[name](tmp_path / name)
    mapped = radio(tmp_path / name)
    receivers = np.array([[0.0, -50.0, 10.0], [130.0, 20.0, 35.0], [200.0, 50.0, 50.0]])
    for k, tx in enumerate(TX):
        expected = plane_db(k, *receivers.T)
        assert gain_db(mapped, tx, receivers) == pytest.approx(expected, abs=1e-9)
        assert gain_db(mapped, receivers, tx) == pytest.approx(expected, abs=1e-9)
    assert gain_db(mapped, TX[0] + (3.0, 0.0, 0.0), receivers) == pytest.approx(plane_db(0, *receivers.T))


def test_the_radios_antennas_are_added(tmp_path):
    write_hdf5(tmp_path / "map.nc4")
    link = radio(tmp_path / "map.nc4").link(position_tx_ned_m=(0, 0, -20), position_rx_ned_m=(100, 0, -30))
    assert float(link.received_power_dbm) == pytest.approx(18.0 + 2 * 2.3 + plane_db(0, 100.0, 0.0, 30.0))


@pytest.mark.parametrize(
    ("tx", "rx"),
    [
        ((0, 0, 20), (201, 0, 30)),  # beyond the grid
        ((0, 0, 20), (100, 0, 51)),  # above it
        ((50, 0, 20), (100, 0, 30)),  # neither end at a transmitter
    ],
)
def test_outside_it_refuses_or_falls_back(tmp_path, tx, rx):
    write_hdf5(tmp_path / "map.nc4")
    with pytest.raises(OutsideValidityError, match=r"place \(north, east, height\)"):
        gain_db(radio(tmp_path / "map.nc4"), tx, rx)
    other = radio(
        tmp_path / "map.nc4", outside="fallback", fallback={"model": "log-distance", "exponent": 3.0}
    )
    distance = float(np.linalg.norm(np.subtract(rx, tx)))
    by_law = float(friis_db(1.0, 2.412e9)) + 30.0 * np.log10(distance)
    mixed = gain_db(other, np.array([tx, (0, 0, 20)], dtype=float), np.array([rx, (100, 0, 30)], dtype=float))
    assert mixed == pytest.approx([-by_law, plane_db(0, 100.0, 0.0, 30.0)])


@pytest.mark.parametrize("user_block_bytes", [512, 1024, 8192])
def test_hdf5_may_begin_behind_a_user_block(tmp_path, user_block_bytes):
    file = tmp_path / "map"
    write_hdf5(file, userblock_size=user_block_bytes)
    with file.open("r+b") as start:
        start.write(b"tx_north_m,tx_east_m\n")
    assert gain_db(radio(file), TX[0], (100, 0, 30)) == pytest.approx(plane_db(0, 100.0, 0.0, 30.0))


def test_another_carrier_is_outside(tmp_path):
    write_hdf5(tmp_path / "map.nc4")
    tree = {"frequency_hz": 5.8e9, "propagation": {"model": "gain-map", "file": str(tmp_path / "map.nc4")}}
    with pytest.raises(OutsideValidityError, match=r"frequency_hz = .*2\.2914e\+09 to 2\.5326e\+09"):
        gain_db(Radio(load_radio("perfect", tree)), (0, 0, 20), (100, 0, 30))


def test_where_no_ray_arrives(tmp_path):
    gains = columns()["gain_db"]
    gains[0, :, 2, :] = -np.inf
    write_hdf5(tmp_path / "map.nc4", gain_db=gains)
    assert float(gain_db(radio(tmp_path / "map.nc4"), (0, 0, 20), (200, 0, 30))) == -200.0
    assert float(gain_db(radio(tmp_path / "map.nc4", no_path_db=-150.0), (0, 0, 20), (200, 0, 30))) == -150.0


def test_a_list_of_receivers(tmp_path):
    """Between fixed places: three transmitters by two receivers."""
    lines = ["tx_north_m,tx_east_m,tx_height_m,rx_north_m,rx_east_m,rx_height_m,gain_db"]
    lines += [f"{100 * i},0,30,{100 * j + 7},5,2,{-70 - 10 * i - j}" for i in range(3) for j in range(2)]
    (tmp_path / "sites.csv").write_text("\n".join(lines))
    mapped = radio(tmp_path / "sites.csv", tolerance_m=1.0)
    assert gain_db(mapped, (200, 0, 30), np.array([(7, 5, 2), (107.5, 5, 2.5)])) == pytest.approx(
        [-90.0, -91.0]
    )
    with pytest.raises(OutsideValidityError):
        gain_db(mapped, (200, 0, 30), (9, 5, 2))


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        (None, "cannot read"),
        (b"tx_north_m\n1\n", "no column 'tx_east_m'"),
        (
            b"tx_north_m,tx_east_m,tx_height_m,rx_north_m,rx_east_m,rx_height_m,gain_db\n1,2,3,4,5,6,x\n",
            "not a CSV of numbers",
        ),
        (b"tx_north_m,tx_east_m,tx_height_m,rx_north_m,rx_east_m,rx_height_m,gain_db\n", "no rows"),
        (
            b"tx_north_m,tx_east_m,tx_height_m,rx_north_m,rx_east_m,rx_height_m,gain_db\n0,0,1,2,3,4,5\n0,0,1,2,3,4,6\n",
            "each pair",
        ),
        (
            b"tx_north_m,tx_east_m,tx_height_m,rx_north_m,rx_east_m,rx_height_m,gain_db\n0,0,1,2,3,4,-70,5\n",
            "line 2 has 8 fields under 7 headings",
        ),
    ],
)
def test_files_that_are_no_maps_are_named(tmp_path, content, problem):
    file = tmp_path / "bad.csv"
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(PresetError, match=problem) as caught:
        radio(file)
    assert caught.value.key == "propagation.file"


def test_maps_with_a_variable_too_few_or_of_another_shape(tmp_path):
    write_hdf5(tmp_path / "map.nc4", rx_north_m=None)
    with pytest.raises(PresetError, match="no variable rx_north_m"):
        radio(tmp_path / "map.nc4")
    write_hdf5(tmp_path / "other.nc4", rx_north_m=NORTH[:2])
    with pytest.raises(PresetError, match="gain_db has shape"):
        radio(tmp_path / "other.nc4")
    write_hdf5(tmp_path / "third.nc4", rx_north_m=NORTH[::-1])
    with pytest.raises(PresetError, match="rx_north_m has to rise"):
        radio(tmp_path / "third.nc4")


def test_variables_beside_those_of_the_map_may_hold_anything(tmp_path):
    write_hdf5(tmp_path / "map.nc4")
    with h5py.File(tmp_path / "map.nc4", "a") as file:
        file["history"] = "made by hand"
        file["table"] = np.zeros(2, dtype=[("a", "i4"), ("b", "f4")])
    assert read_gain_file(tmp_path / "map.nc4").gain_db.shape == (2, 2, 3, 2)


def test_a_variable_that_is_said_to_be_vast_is_refused(tmp_path):
    write_hdf5(tmp_path / "map.nc4")
    with h5py.File(tmp_path / "map.nc4", "a") as file:
        del file["gain_db"]
        file.create_dataset("gain_db", (2, 1000, 1000, 1000), "f4", chunks=(1, 100, 100, 100))
    assert (tmp_path / "map.nc4").stat().st_size < 20_000
    with pytest.raises(GainFileError, match=r"is broken: MemoryError: /gain_db has 16 GB, more than 2"):
        read_gain_file(tmp_path / "map.nc4")


@pytest.mark.parametrize("frequency_hz", [0.0, -2.4e9, float("nan"), float("inf")])
def test_a_carrier_that_cannot_be_is_refused(tmp_path, frequency_hz):
    write_hdf5(tmp_path / "map.nc4")
    with h5py.File(tmp_path / "map.nc4", "a") as file:
        file.attrs["frequency_hz"] = frequency_hz
    with pytest.raises(GainFileError, match=r"map\.nc4: frequency_hz = .*: has to be above 0"):
        read_gain_file(tmp_path / "map.nc4")


@pytest.mark.parametrize("height_m", [np.array([np.nan, np.nan]), np.array([10.0, np.inf])])
def test_a_grid_that_is_not_finite_is_refused(tmp_path, height_m):
    write_hdf5(tmp_path / "map.nc4", rx_height_m=height_m)
    with pytest.raises(GainFileError, match="rx_height_m is not finite"):
        read_gain_file(tmp_path / "map.nc4")


def test_numbers_of_a_map_may_be_texts_in_lists_and_others_are_refused(tmp_path):
    write_hdf5(tmp_path / "plain.nc4")
    for name, value in (("half", ["0.5"]), ("none", [b"abc"]), ("empty", h5py.Empty("f8"))):
        write_hdf5(tmp_path / f"{name}.nc4")
        with h5py.File(tmp_path / f"{name}.nc4", "r+") as data:
            data["gain_db"].attrs["scale_factor"] = value
    whole = read_gain_file(tmp_path / "plain.nc4").gain_db
    assert read_gain_file(tmp_path / "half.nc4").gain_db == pytest.approx(0.5 * whole)
    for name in ("none", "empty"):
        with pytest.raises(GainFileError, match=f"{name}.nc4"):
            read_gain_file(tmp_path / f"{name}.nc4")


def test_a_file_that_hdf5_loops_over_is_refused(tmp_path, monkeypatch):
    """It is read in a process of its own, of which neither a run nor Ctrl-C has to wait for the end."""
    monkeypatch.setattr(netcdf, "_read_netcdf4", APART)
    (tmp_path / "python").write_text("#!/bin/sh\nexec sleep 60\n")
    (tmp_path / "python").chmod(0o755)
    write_hdf5(tmp_path / "map.nc4")
    monkeypatch.setattr(netcdf.sys, "executable", str(tmp_path / "python"))
    monkeypatch.setattr(netcdf, "READ_TIMEOUT_S", 0.2)
    with pytest.raises(GainFileError, match=r"map\.nc4: is broken: HDF5 did not end with it in 0\.2 s"):
        read_gain_file(tmp_path / "map.nc4")


def test_both_ways_of_reading_hdf5_give_the_same(tmp_path, monkeypatch):
    write_packed_hdf5(tmp_path / "map.nc4")
    here = read_gain_file(tmp_path / "map.nc4")
    monkeypatch.setattr(netcdf, "_read_netcdf4", APART)
    write_packed_hdf5(tmp_path / "same.nc4")
    apart = read_gain_file(tmp_path / "same.nc4")
    assert np.array_equal(apart.gain_db, here.gain_db, equal_nan=True)
    assert apart.frequency_hz == here.frequency_hz


def test_what_h5py_says_of_damage_is_an_error_of_the_file(tmp_path):
    """It raises RuntimeError for some of it: here the size of an attribute's type."""
    file = tmp_path / "damaged.nc4"
    write_packed_hdf5(file)
    data = bytearray(file.read_bytes())
    data[data.index(b"scale_factor\0") + 21] = 0xFF
    file.write_bytes(data)
    with pytest.raises(GainFileError, match=r"damaged\.nc4: is broken: "):
        read_gain_file(file)


@pytest.mark.parametrize("write", [write_classic, write_hdf5])
def test_damaged_files_are_named(tmp_path, write):
    """Cut off anywhere, or with bytes changed: a map, or an error that names the file; never another."""
    write(tmp_path / "whole.nc")
    whole = (tmp_path / "whole.nc").read_bytes()
    rng = np.random.Generator(np.random.PCG64(8))
    refused = []
    for k in range(60):
        damaged = bytearray(whole[: rng.integers(4, len(whole))] if k % 2 else whole)
        for place in rng.integers(4, min(len(damaged), 400), 3) if len(damaged) > 8 else ():
            damaged[place] = rng.integers(256)
        file = tmp_path / f"damaged-{k}.nc"
        file.write_bytes(damaged)
        try:
            read_gain_file(file)
        except GainFileError as error:
            refused.append(file.name in str(error))
    assert len(refused) > 20
    assert all(refused)


def test_a_file_beside_the_yaml(tmp_path):
    (tmp_path / "maps").mkdir()
    write_hdf5(tmp_path / "maps" / "map.nc4")
    (tmp_path / "mine.yaml").write_text(
        "preset: perfect\npropagation: {model: gain-map, file: maps/map.nc4}\n"
    )
    config = load_radio(tmp_path / "mine.yaml")
    assert config.propagation.file == str(tmp_path / "maps" / "map.nc4")


def test_a_medium_flies_over_the_map_that_ships(tmp_path):
    """Its script makes it anew, and a UA that sinks behind the ridge is lost to the one that holds."""
    script = runpy.run_path(str(ROOT / "examples" / "maps" / "make_gain_map.py"))
    script["write"](tmp_path / "ridge.nc")
    shipped = ROOT / "sitl_configs" / "maps" / "ridge.nc"
    with netcdf_file(shipped, mmap=False) as old, netcdf_file(tmp_path / "ridge.nc", mmap=False) as new:
        assert old.variables["gain_db"][:] == pytest.approx(new.variables["gain_db"][:], abs=1e-3)
    config = load_radio(
        "corrected",
        {
            "shadowing": {"model": "none"},
            "noise": NO_NOISE,
            "propagation": {"model": "gain-map", "file": str(shipped)},
        },
    )
    medium = Medium(Radio(config), seed=1, nodes=("holds", "flies"))
    medium.place("holds", (0.0, 0.0, -40.0))
    powers = []
    for tick, height in enumerate((80.0, 40.0, 10.0)):
        medium.observe("flies", tick * 10**9, (500.0, 0.0, -height))
        medium.send(medium.packets(tx="holds", seq=tick, sim_time_ns=tick * 10**9, length_bytes=40))
        powers += medium.settle().received_power_dbm.tolist()
    powers += medium.flush().received_power_dbm.tolist()
    free = 18.0 + 2 * 2.3 - float(friis_db(np.hypot(500.0, 40.0), 2.412e9))
    assert powers[0] == pytest.approx(free, abs=0.5)
    assert powers[2] < free - 15.0


def test_what_sionna_traced_in_the_open_is_free_space(tmp_path):
    """Arrays of Sionna RT 2.2: its scene `floor_wall`, line of sight alone, 1e6 rays; gains are means over 1 m."""
    script = runpy.run_path(str(ROOT / "examples" / "maps" / "import_sionna_map.py"))
    with np.load(ROOT / "tests" / "data" / "sionna_rt_floor_wall.npz") as data:
        arrays = {name: data[name] for name in data.files if name != "frequency_hz"}
        script["write_map"](tmp_path / "map.nc", **arrays, frequency_hz=float(data["frequency_hz"]))
    mapped = radio(tmp_path / "map.nc", tolerance_m=0.1)
    mast = np.array([0.0, -3.0, 3.0])  # x -3, y 0
    receivers = np.array([[2.5, east, height] for east in (-4.5, -3.5, -1.5) for height in (1.5, 2.5)])
    distance = np.linalg.norm(receivers - mast, axis=-1)
    assert -gain_db(mapped, mast, receivers) == pytest.approx(friis_db(distance, 2.412e9), abs=0.15)


def test_arrays_of_sionna_become_a_map(tmp_path):
    """Free space by hand, in Sionna's shapes: heights, transmitters, cells y (north), cells x (east)."""
    x, y, heights = np.arange(-95.0, 100.0, 10.0), np.arange(-45.0, 50.0, 10.0), np.array([20.0, 40.0])
    tx = np.array([[5.0, -15.0, 30.0]])
    z, north, east = np.meshgrid(heights, y, x, indexing="ij")
    centers = np.stack((east, north, z), axis=-1)
    squares = np.sum(np.square(centers - tx[0]), axis=-1)
    gain = (299_792_458.0 / 2.412e9 / (4.0 * np.pi)) ** 2 / squares
    gain[0, 0, 0] = 0.0
    np.savez(
        tmp_path / "arrays.npz",
        path_gain=gain[:, np.newaxis].astype(np.float32),
        cell_centers=centers.astype(np.float32),
        tx_positions=tx,
        frequency_hz=2.412e9,
    )
    script = ROOT / "examples" / "maps" / "import_sionna_map.py"
    command = [
        sys.executable,
        script,
        tmp_path / "arrays.npz",
        tmp_path / "map.nc",
        "--origin",
        "5",
        "-5",
        "0",
    ]
    subprocess.run(command, check=True, timeout=60)
    mapped = radio(tmp_path / "map.nc")
    place = (25.0 + 5.0, 55.0 - 5.0, 40.0)  # a cell's centre, y 25 and x 55
    got = float(gain_db(mapped, (-10.0, 0.0, 30.0), place))
    assert got == pytest.approx(-float(friis_db(np.sqrt(40.0**2 + 50.0**2 + 10.0**2), 2.412e9)), abs=1e-4)
    assert float(gain_db(mapped, (-10.0, 0.0, 30.0), (-45.0 + 5.0, -95.0 - 5.0, 20.0))) == -200.0
