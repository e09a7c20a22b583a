"""Terrain from files: a tile that a script made, the same in other projections and formats."""

import importlib.util
import math
import re
import runpy
import sys
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
import yaml

from bridge.scenario.file import parse_scenario
from bridge.scenario.resolve.radio import radio_of
from channel.link.radio import Radio
from channel.presets import PresetError, at_origin, load_radio, radio_from_mapping, radio_to_yaml, seen_from
from channel.propagation.path_loss import friis_db
from fdm.model.geodesy import GeodeticPosition, geodetic_from_ned

ROOT = Path(__file__).parents[4]
TILE = ROOT / "tests" / "data" / "ridge.tif"
HERE = (40.1331, -105.2404, 1690.0)
needs_rasterio = pytest.mark.skipif(
    importlib.util.find_spec("rasterio") is None,
    reason="needs rasterio: pip install 'lostlink[terrain]' (36 MB)",
)


def terrain(file, origin=HERE, **more):
    place = (
        dict(zip(("origin_lat_deg", "origin_lon_deg", "origin_alt_amsl_m"), origin, strict=True))
        if origin
        else {}
    )
    tree = {"model": "terrain", "file": str(file), "extent_m": 1200.0} | place | more
    return load_radio("perfect", {"propagation": tree})


def by_formula(north, east):
    """What `make_terrain_tile.py` says of the ridge, above the origin."""
    return -0.02 * east + 60.0 * np.exp(-(((north - 400.0) / 80.0) ** 2))


def places():
    return np.meshgrid(np.linspace(-1100.0, 1100.0, 45), np.linspace(-900.0, 900.0, 7), indexing="ij")


def test_without_the_library_the_error_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "rasterio", None)
    with pytest.raises(PresetError, match=r"propagation.*lostlink\[terrain\]"):
        terrain(TILE, origin=None)


@needs_rasterio
def test_heights_of_a_geotiff():
    """Whole metres, 31 m by 24 m apart, read bilinearly: within 5 m on the ridge's crest, 0.7 m beside it."""
    north, east = places()
    off = terrain(TILE).propagation.height_m(north, east) - by_formula(north, east)
    assert np.max(np.abs(off)) < 5.0
    assert np.max(np.abs(off[np.abs(north - 400.0) > 250.0])) < 0.7
    assert abs(float(np.mean(off))) < 0.2


@needs_rasterio
def test_the_script_makes_the_tile(tmp_path):
    import rasterio

    runpy.run_path(str(ROOT / "examples" / "maps" / "make_terrain_tile.py"))["write"](tmp_path / "tile.tif")
    with rasterio.open(TILE) as old, rasterio.open(tmp_path / "tile.tif") as new:
        assert np.array_equal(old.read(1), new.read(1))
        assert (old.crs, old.transform) == (new.crs, new.transform)


@needs_rasterio
@pytest.mark.filterwarnings("ignore:Use `@` matmul:PendingDeprecationWarning")  # rasterio's own, of affine
def test_the_same_ground_in_utm(tmp_path):
    """Zone 13 north, whose easting and northing at the origin are known: 479 515 m, 4 442 601 m (to 30 m)."""
    import rasterio
    from rasterio.warp import Resampling, calculate_default_transform, reproject

    with rasterio.open(TILE) as old:
        transform, width, height = calculate_default_transform(
            old.crs, "EPSG:32613", old.width, old.height, *old.bounds
        )
        shape = {"width": width, "height": height, "count": 1, "dtype": "float32", "nodata": -9999.0}
        with rasterio.open(
            tmp_path / "utm.tif", "w", driver="GTiff", crs="EPSG:32613", transform=transform, **shape
        ) as new:
            reproject(rasterio.band(old, 1), rasterio.band(new, 1), resampling=Resampling.bilinear)
    middle = transform.a * width / 2 + transform.c, transform.e * height / 2 + transform.f
    assert middle == pytest.approx((479_515.0, 4_442_601.0), abs=60.0)
    north, east = places()
    north, east = north * 0.8, east * 0.8
    geographic = terrain(TILE, extent_m=900.0).propagation.height_m(north, east)
    projected = terrain(tmp_path / "utm.tif", extent_m=900.0).propagation.height_m(north, east)
    assert projected == pytest.approx(geographic, abs=3.0)
    assert float(np.mean(np.abs(projected - geographic))) < 0.5


@needs_rasterio
def test_an_srtm_tile(tmp_path):
    """N40W106.hgt: 1201 by 1201 big-endian numbers, three seconds of arc apart, its name the south-west corner."""
    lat = 41.0 - np.arange(1201)[:, np.newaxis] / 1200.0
    lon = -106.0 + np.arange(1201)[np.newaxis, :] / 1200.0
    height = np.round(1690.0 + 2000.0 * (lat - HERE[0]) - 1000.0 * (lon - HERE[1]))
    (tmp_path / "N40W106.hgt").write_bytes(height.astype(">i2").tobytes())
    ground = terrain(tmp_path / "N40W106.hgt", extent_m=3000.0).propagation
    north, east = places()
    lat_of, lon_of = north / 111_319.5, east / (111_319.5 * np.cos(np.radians(HERE[0])))
    assert ground.height_m(north, east) == pytest.approx(2000.0 * lat_of - 1000.0 * lon_of, abs=0.7)


@needs_rasterio
def test_a_grid_lies_where_a_runs_positions_lie(tmp_path):
    """On ArduPilot's scale, 40 km about: a tile that rises by 1 m per 1e-4 degrees tells 11 mm."""
    import rasterio

    step = 0.01
    lat, lon = np.meshgrid(40.6331 - np.arange(101) * step, -105.8404 + np.arange(121) * step, indexing="ij")
    height = (lat - HERE[0]) * 1e4 + (lon - HERE[1]) * 1e4
    place = rasterio.Affine(step, 0.0, lon[0, 0] - step / 2, 0.0, -step, lat[0, 0] + step / 2)
    shape = {"width": 121, "height": 101, "count": 1, "dtype": "float64"}
    with rasterio.open(
        tmp_path / "slope.tif", "w", driver="GTiff", crs="EPSG:4326", transform=place, **shape
    ) as out:
        out.write(height, 1)
    ground = terrain(tmp_path / "slope.tif", (*HERE[:2], 0.0), extent_m=40e3, spacing_m=1000.0).propagation
    for north, east in ((40e3, 0.0), (-40e3, 40e3), (0.0, -40e3)):
        there = geodetic_from_ned(GeodeticPosition(*HERE), (north, east, 0.0))
        rise = (there.lat_deg - HERE[0]) * 1e4 + (there.lon_deg - HERE[1]) * 1e4
        assert float(ground.height_m(np.array(north), np.array(east))) == pytest.approx(rise, abs=0.001)


@needs_rasterio
def test_a_link_behind_the_ridge():
    radio = Radio(terrain(TILE))
    high, low = (
        radio.link(position_tx_ned_m=(0.0, 0.0, -height), position_rx_ned_m=(800.0, 0.0, -height))
        for height in (150.0, 20.0)
    )
    free = float(friis_db(800.0, 2.412e9))
    assert float(high.path_loss_db) == pytest.approx(free, abs=0.01)
    assert float(low.path_loss_db) > free + 25.0


@needs_rasterio
def test_a_scenario_gives_its_origin(tmp_path):
    text = (ROOT / "sitl_configs" / "scenarios" / "separation.yaml").read_text()
    (tmp_path / "tile.tif").write_bytes(TILE.read_bytes())
    law = "{model: terrain, file: tile.tif, extent_m: 1000}"
    scenario = parse_scenario(
        text.replace("radio: hata-qpsk", f"radio: {{preset: corrected, propagation: {law}}}"), "x", tmp_path
    )
    ground = radio_of(scenario).config.propagation
    assert (ground.origin_lat_deg, ground.origin_lon_deg, ground.origin_alt_amsl_m) == HERE
    assert float(ground.height_m(np.asarray(400.0), np.asarray(0.0))) == pytest.approx(60.0, abs=5.0)
    copy = yaml.safe_load(radio_to_yaml(radio_of(scenario).config))
    assert radio_from_mapping(copy).propagation == ground


@needs_rasterio
@pytest.mark.parametrize(
    ("changed", "problem"),
    [
        ({"extent_m": 5000.0}, r"covers \d+ % of the square"),
        ({"extent_m": 1200.0, "spacing_m": 0.1}, "at most 16000000"),
        ({"origin_lat_deg": 41.0}, "covers 0 % of the square"),
    ],
)
def test_what_a_tile_does_not_have_is_told_at_once(changed, problem):
    with pytest.raises(PresetError, match=problem):
        terrain(TILE, **changed)


@needs_rasterio
def test_files_that_are_none_are_named(tmp_path):
    (tmp_path / "bad.tif").write_bytes(b"no tile")
    for name in ("bad.tif", "none.tif"):
        with pytest.raises(PresetError, match=name):
            terrain(tmp_path / name)
    with pytest.raises(PresetError, match=r"bad\.tif"):
        at_origin(terrain(tmp_path / "bad.tif", origin=None), *HERE)
    later = at_origin(terrain(TILE, origin=None), *HERE)
    assert later == terrain(TILE)


def changed_tile(file, change, *, nodata=None, **attributes):
    """Write the tile with other numbers, as GDAL keeps them with a scale, an offset and a unit."""
    import rasterio

    with rasterio.open(TILE) as old:
        heights, profile = change(old.read(1)), old.profile
    with rasterio.open(file, "w", **profile | {"nodata": nodata, "dtype": heights.dtype}) as new:
        new.write(heights, 1)
        for name, value in attributes.items():
            setattr(new, name, (value,))
    return file


@needs_rasterio
def test_scale_and_offset_of_a_file_count(tmp_path):
    """Decimetres above 1000 m, as whole numbers."""
    file = tmp_path / "scaled.tif"
    changed_tile(
        file, lambda heights: (10 * (heights - 1000)).astype("int16"), scales=0.1, offsets=1000.0, units="m"
    )
    north, east = places()
    found = terrain(file).propagation.height_m(north, east)
    assert found == pytest.approx(terrain(TILE).propagation.height_m(north, east), abs=2e-3)


@needs_rasterio
@pytest.mark.parametrize("unit", ["ft", "US survey foot", "Feet", "ftUS", "cm", "millimetre", "km"])
def test_heights_in_other_units_are_refused(tmp_path, unit):
    file = changed_tile(tmp_path / "feet.tif", lambda heights: heights, units=unit)
    with pytest.raises(PresetError, match=rf"feet\.tif: its heights are in {unit}: has to be metres"):
        terrain(file)


@needs_rasterio
@pytest.mark.parametrize("unit", ["metre (above the reference)", "[m]", "Meters EGM96"])
def test_a_unit_of_metres_may_say_more_than_its_name(tmp_path, unit):
    file = changed_tile(tmp_path / "metres.tif", lambda heights: heights, units=unit)
    assert terrain(file).propagation.height_m(*places()) == pytest.approx(
        terrain(TILE).propagation.height_m(*places())
    )


@needs_rasterio
def test_gaps_that_are_not_marked_are_refused(tmp_path):
    def with_gap(heights):
        heights = heights.astype("float32")
        heights[60, 60] = np.nan
        return heights

    with pytest.raises(PresetError, match=r"gaps\.tif: has gaps"):
        terrain(changed_tile(tmp_path / "gaps.tif", with_gap))


@needs_rasterio
def test_gaps_are_refused(tmp_path):
    import rasterio

    with rasterio.open(TILE) as old:
        heights, profile = old.read(1), old.profile
    heights[60, 60] = -32768
    with rasterio.open(tmp_path / "gaps.tif", "w", **profile | {"nodata": -32768}) as new:
        new.write(heights, 1)
    with pytest.raises(PresetError, match=r"gaps\.tif: has gaps"):
        terrain(tmp_path / "gaps.tif")


@needs_rasterio
@pytest.mark.parametrize("gap", [-32768.0, -12_001.0, 9001.0, 3.4e38])
def test_gaps_that_a_file_does_not_declare_are_no_heights(tmp_path, gap):
    def with_gap(heights):
        heights = heights.astype("float32")
        heights[60, 60] = gap
        return heights

    with pytest.raises(PresetError, match=rf"gaps\.tif: has a height of {re.escape(f'{gap:g}')} m"):
        terrain(changed_tile(tmp_path / "gaps.tif", with_gap))


@needs_rasterio
@pytest.mark.parametrize("height_m", [-10_994.0, 8849.0])
def test_the_deepest_and_the_highest_place_of_earth_are_heights(tmp_path, height_m):
    tile = changed_tile(tmp_path / "there.tif", lambda heights: np.full_like(heights, height_m, "float32"))
    assert float(terrain(tile).propagation.height_m(0.0, 0.0)) == pytest.approx(height_m - HERE[2], abs=0.01)


@needs_rasterio
def test_a_scale_that_is_none_is_told(tmp_path):
    file = changed_tile(tmp_path / "scaled.tif", lambda heights: heights, scales=math.nan, offsets=0.0)
    with pytest.raises(PresetError, match=r"scaled\.tif: has a height of nan m .* scale and offset"):
        terrain(file)


def test_a_path_is_as_seen_from_its_yaml(tmp_path):
    tree = seen_from(tmp_path, {"preset": "perfect", "propagation": {"model": "terrain", "file": "tile.tif"}})
    assert tree["propagation"]["file"] == str(tmp_path / "tile.tif")
    assert math.isfinite(HERE[0])


@needs_rasterio
def test_a_file_far_finer_than_the_grid_is_read_in_parts(tmp_path):
    rasterio = importlib.import_module("rasterio")
    file, count = tmp_path / "fine.tif", 6000
    transform = rasterio.Affine(1e-5, 0.0, HERE[1] - 0.03, 0.0, -1e-5, HERE[0] + 0.03)
    shape = {"height": count, "width": count, "count": 1, "dtype": "int16", "crs": "EPSG:4326"}
    with rasterio.open(file, "w", driver="GTiff", transform=transform, tiled=True, SPARSE_OK=True, **shape):
        pass  # zeros
    tracemalloc.start()
    try:
        model = terrain(file, spacing_m=30.0, extent_m=2000.0).propagation
        peak_bytes = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert float(model.height_m(0.0, 0.0)) == -HERE[2]
    assert peak_bytes < count * count * 8 / 4  # of all its points as numbers
