import re
from pathlib import Path

import pytest
import yaml

from channel import presets
from channel.access.packets import AirFrame
from channel.access.world import Piece
from channel.draws import Draws
from channel.link.radio import Radio
from channel.medium.simulate import simulate
from channel.network.radio_world import RadioWorld
from channel.presets import PresetError


def test_first_presets_ship():
    assert {"moon2020", "moon2020-table3", "corrected", "disk", "perfect"} <= set(presets.preset_names())


@pytest.mark.parametrize("name", presets.preset_names())
def test_each_preset_says_what_it_is_and_survives_a_round_trip(name, tmp_path):
    config = presets.load_radio(name)
    assert config.name == name
    assert config.description
    assert config.source
    file = tmp_path / "copy.yaml"
    file.write_text(presets.radio_to_yaml(config))
    assert presets.load_radio(file) == config


def test_extending_a_preset_keeps_the_other_keys_of_a_group():
    config = presets.radio_from_mapping({"preset": "moon2020", "propagation": {"exponent": 9.0}})
    assert config.propagation.model == "log-distance"
    assert config.propagation.exponent == 9.0
    assert config.noise == presets.load_radio("moon2020").noise


def test_another_model_in_a_group_keeps_nothing_of_the_old():
    config = presets.radio_from_mapping(
        {"preset": "moon2020", "noise": {"model": "thermal", "noise_figure_db": 3}}
    )
    assert config.noise.noise_figure_db == 3.0


@pytest.mark.parametrize(
    ("mapping", "key", "problem"),
    [
        ({"preset": "moon2020", "propagation": {"exponnet": 3}}, "propagation.exponnet", "exponent"),
        ({"preset": "moon2020", "noise": {"flor": -3}}, "noise.flor", "model, floor_dbm"),
        ({"preset": "moon2020", "propagation": {"model": "magic"}}, "propagation.model", "log-distance"),
        ({"preset": "moon2020", "frequency_hz": -1}, "frequency_hz", "1000000 (got -1)"),
        ({"preset": "moon2020", "frequency_hz": float("nan")}, "frequency_hz", "finite"),
        ({"preset": "mon2020"}, "preset", "did you mean moon2020"),
        ({"name": "empty"}, "frequency_hz", "missing"),
        (
            {"preset": "moon2020", "medium": "csma"},
            "medium",
            "elrs, sik (got 'csma'), as in medium: {model: csma}",
        ),
        ({"preset": "moon2020", "noise": 5}, "noise", "with model, one of: fixed, thermal, man-made (got 5)"),
        (
            {"preset": "moon2020", "medium": {"type": "csma"}},
            "medium",
            "model is missing: has to be one of: ideal",
        ),
        ({"preset": "moon2020", "offset_db": True}, "offset_db", "has to be a number (got true)"),
        ({"preset": "moon2020", "mtu_bytes": False}, "mtu_bytes", "has to be a whole number (got false)"),
        ({"preset": "moon2020", "noise": {"floor_dbm": True}}, "noise.floor_dbm", "a number (got true)"),
        (
            {"preset": "moon2020", "interference": {"rejection": [[True, 3]]}},
            "interference.rejection.0.0",
            "a number (got true)",
        ),
        (
            {"preset": "moon2020", "fading": {}},
            "fading",
            "model is missing: has to be one of: none, rayleigh",
        ),
    ],
)
def test_mistakes_name_the_key_and_what_is_allowed(mapping, key, problem):
    with pytest.raises(PresetError) as caught:
        presets.radio_from_mapping(mapping)
    assert caught.value.key == key
    assert problem in str(caught.value)


def test_mistakes_in_a_file_name_file_and_line(tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text("preset: moon2020\n\nshadowing:\n  sigma_db: -3\n")
    with pytest.raises(PresetError) as caught:
        presets.load_radio(file)
    assert (caught.value.file, caught.value.line, caught.value.key) == (str(file), 4, "shadowing.sigma_db")


def test_all_mistakes_are_told_at_once_each_in_the_file_that_has_it(tmp_path):
    (tmp_path / "base.yaml").write_text("preset: moon2020\nbase_loss: 3\n")
    file = tmp_path / "mine.yaml"
    file.write_text("preset: base.yaml\nbandwidth_hz: -1\npropagation: {exponnet: 3}\n")
    over = {"preset": str(file), "noise": {"model": "thermal", "nois": 3}, "cable_loss_db": -1}
    with pytest.raises(PresetError) as caught:
        presets.radio_from_mapping(over)
    assert {(each.file, each.line, each.key) for each in caught.value.mistakes} == {
        (str(file), 2, "bandwidth_hz"),
        (str(file), 3, "propagation.exponnet"),
        (str(tmp_path / "base.yaml"), 2, "base_loss"),
        (None, None, "noise.nois"),
        (None, None, "cable_loss_db"),
    }
    assert len(str(caught.value).splitlines()) == 5


def test_what_may_be_true_still_may():
    sik = presets.radio_from_mapping({"preset": "sik-433", "medium": {"ecc": True}})
    assert sik.medium.ecc is True


def test_what_a_group_that_is_replaced_lacks_is_no_mistake_of_the_preset():
    with pytest.raises(PresetError, match="missing: only uma-av and rma-av") as caught:
        presets.radio_from_mapping({"preset": "moon2020", "shadowing": {"model": "normal"}})
    assert (caught.value.file, caught.value.key) == (None, "shadowing.sigma_db")


@pytest.mark.parametrize(
    ("group", "told"),
    [
        ({"antenna": {"model": "pattern"}}, "antenna.pattern: is required, and missing"),
        (
            {"interference": {"rejection": [[1, 2, 3]]}},
            "interference.rejection.0: has to have at most 2 items, not 3",
        ),
        ({"antenna": {"model": "pattern", "pattern": [[1, 2]]}}, "antenna.pattern.0.2: is missing"),
        (
            {"propagation": None},
            "propagation: has to be a mapping of keys to values with model, one of: free-space",
        ),
        ({"base_loss": None}, "base_loss: has to be a number (got null)"),
        ({"polarisation": {"model": "x"}}, "polarisation.model: unknown key; allowed here: cross_polar_db"),
        ({"routing": {"model": "flood"}}, "routing: flood: each hop takes time on the air"),
        (
            {"medium": {"model": "tdma", "schedule": {"slots": [{"nodes": 0}]}}},
            "medium.schedule.slots.0.duration_s: is required, and missing",
        ),
        ({"medium": {"model": "sik", "units": {"a": [0, 1]}}}, "medium.units.a: has to be a whole number"),
        ({"medium": {"model": "ideal", "ideal": 1}}, "medium.ideal: unknown key; did you mean model?"),
        ({"medium": {"model": "elrs", "mode": "x"}}, "medium.mode: has to be one of: flrc-1000, lora-500"),
        (
            {"routing": {"model": "static", "routes": {"int": {"float": [2]}}}},
            "routing.routes.int.float: has to be text (got [2])",
        ),
    ],
)
def test_no_mistake_has_words_of_the_validation_in_it(group, told):
    with pytest.raises(PresetError) as caught:
        presets.radio_from_mapping({"preset": "moon2020"} | group)
    assert str(caught.value).startswith(told)
    assert len(caught.value.mistakes) == 1


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("preset: [a]", "preset: no radio preset or YAML file"),
        ("medium: {model: tdma, schedule_file: no.yaml}", "medium.schedule_file: cannot read"),
    ],
)
def test_a_file_that_names_what_is_not_there_is_named_itself(tmp_path, line, told):
    file = tmp_path / "mine.yaml"
    file.write_text(f"offset_db: 3\n{line}\n")
    with pytest.raises(PresetError) as caught:
        presets.load_radio(file)
    assert str(caught.value).startswith(f"{file}:2: {told}")


def test_a_misspelt_key_is_not_missing_as_well():
    with pytest.raises(PresetError, match="did you mean frequency_hz") as caught:
        presets.radio_from_mapping({"frequenzy_hz": 1e9, "transmit_power_dbm": 20})
    assert len(caught.value.mistakes) == 1


def test_text_that_is_not_yaml(tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text("a: [1\nb: }\n")
    with pytest.raises(PresetError, match=r"mine\.yaml:2: is not YAML"):
        presets.load_radio(file)


def test_a_file_that_is_nested_too_deeply_is_refused(tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text("a: " + "[\n" * 10_000)
    with pytest.raises(PresetError, match=r"mine\.yaml: is nested too deeply"):
        presets.load_radio(file)


def test_settings_become_overrides():
    tree = presets.overrides_from_settings(
        ["propagation.exponent=3", "frequency_hz=2.4e9", "noise.model=thermal"]
    )
    config = presets.load_radio("moon2020", tree)
    assert config.propagation.exponent == 3.0
    assert config.frequency_hz == 2.4e9
    assert config.noise.model == "thermal"
    assert presets.overrides_from_settings(["name='007'"]) == {"name": "007"}


@pytest.mark.parametrize(
    "setting",
    [
        "earth_radius_factor=1e-300",
        "polarisation.cross_polar_db=1e-300",
        "propagation={model: terrain, file: there.tif, step_m: 1e-300}",
        "propagation={model: terrain, file: there.tif, spacing_m: 1e-300}",
        "propagation={model: terrain, file: there.tif, earth_radius_factor: 1e-300}",
    ],
)
def test_numbers_too_small_to_reckon_with_are_refused_by_their_key(setting):
    """They were tracebacks: an index out of range, a division by zero, an array that is too large."""
    with pytest.raises(PresetError, match=r"has to be greater than or equal to 0\.\d+ \(got 1e-300\)"):
        presets.load_radio("perfect", presets.overrides_from_settings([setting]))


@pytest.mark.parametrize("setting", ["exponent", "=3", "a..b=1", "a=[1"])
def test_settings_that_are_none(setting):
    with pytest.raises(PresetError):
        presets.overrides_from_settings([setting])


def test_files_that_cannot_be_are_named(tmp_path):
    (tmp_path / "bytes.yaml").write_bytes(bytes(range(256)))
    with pytest.raises(PresetError, match=r"bytes\.yaml: is not a file of text"):
        presets.load_radio(tmp_path / "bytes.yaml")
    (tmp_path / "number.yaml").write_text("1: 2\npreset: moon2020\n")
    with pytest.raises(PresetError, match=r"number\.yaml.*1: unknown key"):
        presets.load_radio(tmp_path / "number.yaml")
    (tmp_path / "a.yaml").write_text("preset: b.yaml\n")
    (tmp_path / "b.yaml").write_text("preset: a.yaml\n")
    with pytest.raises(PresetError, match=r"a\.yaml: preset: extends itself"):
        presets.load_radio(tmp_path / "a.yaml")
    (tmp_path / "table.yaml").write_text(
        "preset: moon2020\nerror: {model: snr-table, table_file: bytes.yaml}\n"
    )
    with pytest.raises(PresetError, match=r"bytes\.yaml is not a CSV"):
        presets.load_radio(tmp_path / "table.yaml")


def test_a_file_is_extended_by_one_beside_it(tmp_path):
    (tmp_path / "base.yaml").write_text("preset: moon2020\nbase_loss: 0.25\n")
    (tmp_path / "mine.yaml").write_text("preset: base.yaml\noffset_db: 1\n")
    config = presets.load_radio(tmp_path / "mine.yaml")
    assert (config.base_loss, config.offset_db) == (0.25, 1.0)


def test_tables_can_be_set_and_given_in_a_mapping(tmp_path):
    table = tmp_path / "curve.csv"
    table.write_text("snr_db,per\n0,1\n5,0.5\n10,0\n")
    settings = ["error.model=snr-table", f"error.table_file={table}"]
    set_radio = presets.load_radio("moon2020", presets.overrides_from_settings(settings))
    spelled = presets.radio_from_mapping(
        {"preset": "moon2020", "error": {"model": "snr-table", "table_file": str(table)}}
    )
    assert set_radio.error == spelled.error
    assert set_radio.error.table == ((0.0, 1.0), (5.0, 0.5), (10.0, 0.0))


def test_no_packet_comes_through_a_signal_at_which_a_table_has_none(tmp_path):
    """Packets of 40 bytes, a table of 1000, and a jammer that is on for 1 % of a frame."""
    (tmp_path / "curve.csv").write_text("snr_db,per\n0,1\n5,0\n")
    (tmp_path / "radio.yaml").write_text(
        "preset: perfect\npropagation: {model: free-space}\nearth_radius_factor:\n"
        "error: {model: snr-table, table_file: curve.csv, reference_length_bytes: 1000}\n"
    )
    radio = Radio(presets.load_radio(tmp_path / "radio.yaml"))
    far_m = float(10.0 ** (float(radio.link(1.0).snr_db) / 20.0))
    near, far = 0.5 * far_m, 1.01 * far_m
    assert radio.probability_of_delivery([near, far], 40).tolist() == [1.0, 0.0]
    assert radio.expected_delivery([near, far], length_bytes=40).tolist() == [1.0, 0.0]
    drawn = [
        simulate(radio, Draws(1), [("a", "b")], at_m, packets=500, length_bytes=40) for at_m in (near, far)
    ]
    assert [int(each.delivered.sum()) for each in drawn] == [500, 0]

    world = RadioWorld(radio, {0: (0.0, 0.0, -40.0), 1: (near, 0.0, -40.0)})
    [arrival] = world.reach(AirFrame(0, 0, "data", 40, 0, 1_000_000))
    quiet, jammed = Piece(990_000, 0.0), Piece(10_000, 100.0 * arrival.power_mw)
    frames = [AirFrame(0, number, "data", 40, 0, 1_000_000) for number in range(100)]
    fates = {world.survives(frame, 1, arrival.power_mw, [quiet, jammed]) for frame in frames}
    assert fates == {(False, True)}


ATTACH = (Path(__file__).parents[3] / "docs" / "how-to" / "attach.md").read_text(encoding="utf-8")
FOR_IP = yaml.safe_load(re.search(r"```yaml\n(wifi-2.4: .*?)```", ATTACH, re.DOTALL)[1])


@pytest.mark.parametrize("name", FOR_IP)
def test_a_preset_for_ip_packets_as_the_page_on_attached_programs_has_it(name):
    """1500 bytes of IP last as long, and count for as many, as the 1472 of a datagram in them."""
    datagrams, packets = presets.load_radio(name), presets.radio_from_mapping({"preset": name} | FOR_IP[name])
    assert (datagrams.mtu_bytes, packets.mtu_bytes) == (1472, 1500)
    assert datagrams.length.length_bytes(1472) == packets.length.length_bytes(1500)
    assert getattr(packets.medium, "max_length_bytes", 1500) >= 1500
    if packets.medium.takes_time:
        frame_s = [8 * n / each.medium.capacity_bps(n, 0) for each, n in ((datagrams, 1472), (packets, 1500))]
        assert frame_s[0] == pytest.approx(frame_s[1])


def test_the_page_on_attached_programs_has_all_presets_for_datagrams():
    assert set(FOR_IP) == {
        name for name in presets.preset_names() if presets.load_radio(name).mtu_bytes == 1472
    }


MAC_BYTES = 24 + 8 + 4
"""Of 802.11: header, LLC and SNAP, FCS."""


def test_headers_of_a_preset_are_the_same_on_its_medium_and_without_time():
    headers = {
        name: (
            config.length.overhead_bytes,
            config.medium.header_bytes + MAC_BYTES * (config.medium.model == "csma"),
        )
        for name in presets.preset_names()
        if hasattr((config := presets.load_radio(name)).medium, "header_bytes")
    }
    assert headers == {
        **dict.fromkeys(("wifi-2.4", "wifi-5.8"), (64, 64)),
        **dict.fromkeys(("lte-uav", "satellite"), (28, 28)),
        "xbee-900hp": (24, 24),
    }


@pytest.mark.parametrize(
    ("preset", "mtu_bytes"),
    [("wifi-2.4", 1472), ("wifi-5.8", 1472), ("lte-like", 1472), ("telemetry-915", 1850), ("perfect", 65535)],
)
def test_the_longest_payload_is_that_of_the_radio(preset, mtu_bytes):
    assert presets.load_radio(preset).mtu_bytes == mtu_bytes
