import re

import pytest
import yaml

from fdm.errors import AirframeError
from fdm.model.airframe import AIRFRAMES_DIR, airframe_names, load_airframe


@pytest.fixture
def f450_data():
    return yaml.safe_load((AIRFRAMES_DIR / "f450.yaml").read_text())


def write(tmp_path, data):
    path = tmp_path / "mine.yaml"
    path.write_text(data if isinstance(data, str) else yaml.safe_dump(data, sort_keys=False))
    return path


@pytest.mark.parametrize("name", airframe_names())
def test_every_airframe_that_ships_is_valid_and_named_as_its_file(name):
    assert load_airframe(name).name == name


def test_f450_maps_the_motors_in_ardupilots_order():
    channels = load_airframe("f450").channels
    assert [(c.channel, c.property) for c in channels] == [
        (1, "fcs/throttle-cmd-norm[0]"),
        (2, "fcs/throttle-cmd-norm[1]"),
        (3, "fcs/throttle-cmd-norm[2]"),
        (4, "fcs/throttle-cmd-norm[3]"),
    ]


@pytest.mark.parametrize(
    "name", ["f450", "hexa550", AIRFRAMES_DIR.parents[1] / "examples/airframe/mini.yaml"]
)
def test_sitl_knows_which_channels_of_a_copter_are_motors_that_draw_current(name):
    airframe = load_airframe(name)
    bits = sum(1 << (c.channel - 1) for c in airframe.channels if c.property.startswith("fcs/throttle"))
    assert airframe.ardupilot_parameters["SIM_VIB_MOT_MASK"] == bits


def test_an_unknown_name_lists_the_known_ones():
    with pytest.raises(AirframeError, match=r"unknown airframe 'f451'.*f450"):
        load_airframe("f451")


def test_a_missing_file_is_named():
    with pytest.raises(AirframeError, match=r"no airframe file .*nowhere\.yaml"):
        load_airframe("/nowhere.yaml")


def test_the_page_has_what_a_misspelt_key_of_its_example_is_told_as(tmp_path, monkeypatch):
    root = AIRFRAMES_DIR.parents[1]
    example = (root / "examples" / "airframe" / "mini.yaml").read_text()
    page = (root / "docs" / "reference" / "fdm-airframes.md").read_text()
    lines = re.findall(r"^ *(?:error: )?(mini\.yaml:.*?)(?:, \.\.\.)?$", page, re.MULTILINE)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mini.yaml").write_text(example.replace("{channel: 4", "{channl: 4"))
    with pytest.raises(AirframeError) as told:
        load_airframe("mini.yaml")
    [line] = lines
    assert str(told.value).startswith(line)
    assert "\n" not in str(told.value)


def test_an_unknown_key_is_named_with_file_and_line(tmp_path, f450_data):
    f450_data["channels"][1]["gain"] = 2
    path = write(tmp_path, f450_data)
    line = 1 + next(i for i, text in enumerate(path.read_text().splitlines()) if "gain" in text)
    with pytest.raises(AirframeError, match=rf"mine\.yaml:{line}: channels\.1\.gain: unknown key"):
        load_airframe(path)


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("range", [1, 0], "the first must be below"),
        ("no_output", 2.0, "outside the range"),
        ("channel", 33, "less than or equal to 32"),
        ("sign", 2, "1 or -1"),
        ("sign", True, r"channels\.0\.sign: has to be 1 or -1 \(got true\)"),
        ("range", [0, True], r"channels\.0\.range\.1: has to be a number \(got true\)"),
        ("scale_per_us", float("nan"), "finite"),
    ],
)
def test_a_bad_value_of_a_channel_is_explained(tmp_path, f450_data, key, value, message):
    f450_data["channels"][0][key] = value
    with pytest.raises(AirframeError, match=message):
        load_airframe(write(tmp_path, f450_data))


@pytest.mark.parametrize("key", ["int", "float"])
def test_a_parameter_may_have_the_name_of_a_kind_of_number(tmp_path, f450_data, key):
    f450_data["ardupilot_parameters"] = {key: "x"}
    with pytest.raises(AirframeError, match=rf"ardupilot_parameters\.{key}: has to be a number \(got 'x'\)"):
        load_airframe(write(tmp_path, f450_data))


def test_a_property_has_one_driver(tmp_path, f450_data):
    f450_data["channels"][0]["property"] = f450_data["channels"][1]["property"]
    with pytest.raises(AirframeError, match="more than one channel"):
        load_airframe(write(tmp_path, f450_data))


@pytest.mark.parametrize("text", ["", "- 1", "a: [", "\x00", "name: a\nname: b", "[" * 100_000])
def test_a_file_that_is_no_airframe_is_an_airframe_error(tmp_path, text):
    with pytest.raises(AirframeError, match=r"mine\.yaml"):
        load_airframe(write(tmp_path, text))


def test_a_root_is_found_from_the_file(tmp_path, f450_data):
    f450_data["jsbsim"]["root"] = "models"
    with pytest.raises(AirframeError, match=r"jsbsim\.root: no directory"):
        load_airframe(write(tmp_path, f450_data))
    (tmp_path / "models").mkdir()
    assert load_airframe(write(tmp_path, f450_data)).jsbsim.root == tmp_path / "models"
