"""Models of a user: from a file beside the YAML, from a module, by entry point."""

import importlib.metadata
import math
import os
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

from channel import presets
from channel.link.radio import Radio
from channel.medium.medium import Medium
from channel.own import models as own
from channel.presets import PresetError

EXAMPLE = Path(__file__).parents[4] / "examples" / "models" / "my_models.py"
TEXT = """\
preset: perfect
propagation: {class: "models/mine.py:Steep", exponent: 5.0}
"""
CODE = """\
import numpy as np
from channel.variant import Variant


class Steep(Variant):
    exponent: float = 4.0

    def path_loss_db(self, path):
        return 10.0 * self.exponent * np.log10(path.distance_m)


class Nothing(Variant):
    pass


class Plain:
    pass
"""
METHODS = "".join(
    f"    {name} = property(lambda self: 0)\n"
    for name in ("path_loss_db", "takes_time", "open", "capacity_bps", "copies")
)


@pytest.fixture
def mine(tmp_path):
    (tmp_path / "models").mkdir()
    (tmp_path / "models" / "mine.py").write_text(CODE)
    (tmp_path / "mine.yaml").write_text(TEXT)
    return tmp_path


def test_a_class_of_a_file_beside_the_yaml(mine):
    radio = Radio(presets.load_radio(mine / "mine.yaml"))
    assert float(radio.link(100.0).path_loss_db) == pytest.approx(100.0)
    again = Radio(presets.load_radio(mine / "mine.yaml", {"propagation": {"exponent": 3.0}}))
    assert float(again.link(100.0).path_loss_db) == pytest.approx(60.0)


def test_it_survives_being_written_down(mine):
    config = presets.load_radio(mine / "mine.yaml")
    copy = mine / "elsewhere" / "copy.yaml"
    copy.parent.mkdir()
    copy.write_text(presets.radio_to_yaml(config))
    assert presets.load_radio(copy) == config
    assert presets.load_radio(
        "perfect", presets.seen_from(mine, {"propagation": {"class": "models/mine.py:Steep"}})
    )


def test_what_is_written_down_of_it_is_what_was_given(mine):
    """A relative path in a default would be another one as seen from where the radio is written."""
    (mine / "models" / "mapped.py").write_text(
        CODE.replace("exponent: float = 4.0", "file: str = 'town.json'\n    exponent: float = 4.0")
    )
    law = {"class": "models/mapped.py:Steep", "exponent": 5.0}
    config = presets.load_radio("perfect", presets.seen_from(mine, {"propagation": law}))
    again = presets.radio_from_mapping(yaml.safe_load(presets.radio_to_yaml(config)))
    assert (again.propagation.file, again.propagation.exponent) == ("town.json", 5.0)
    assert again == config


def test_a_medium_uses_it(mine):
    medium = Medium(Radio(presets.load_radio(mine / "mine.yaml")), seed=1, nodes=("a", "b"))
    medium.place("a", (0.0, 0.0, -40.0))
    medium.place("b", (100.0, 0.0, -40.0))
    medium.send(medium.packets(tx="a", seq=0, length_bytes=10))
    assert medium.settle().received_power_dbm[0] == pytest.approx(18.0 + 2 * 2.3 - 100.0)


@pytest.mark.parametrize(
    ("group", "problem"),
    [
        (
            {"class": "mine.py:Steep", "exponnet": 1.0},
            r"propagation\.exponnet: unknown key; did you mean exponent\?",
        ),
        (
            {"class": "mine.py:Steep", "exponent": "x"},
            "propagation.exponent: has to be a number \\(got 'x'\\)",
        ),
        ({"class": "mine.py:Nothing"}, "Nothing in .*has no path_loss_db"),
        ({"class": "mine.py:Plain"}, r"is no subclass of channel\.variant\.Variant"),
        ({"class": "mine.py:Flat"}, "has no class Flat"),
        ({"class": "other.py:Steep"}, r"other\.py: no such file"),
        ({"class": "no_such_module:Steep"}, "no module no_such_module"),
        ({"class": "Steep"}, r"is not file\.py:Name or module:Name"),
        ({"model": "steep"}, "propagation.model: has to be one of: .* \\(got 'steep'\\)"),
    ],
)
def test_mistakes_are_named(mine, group, problem):
    tree = presets.seen_from(mine / "models", {"preset": "perfect", "propagation": group})
    with pytest.raises(PresetError, match=problem) as caught:
        presets.radio_from_mapping(tree)
    assert caught.value.key.startswith("propagation")


@pytest.mark.parametrize(
    ("body", "problem"),
    [
        ("return path.distance_km", r"wrong\.py:7: AttributeError: .*a Path has frequency_hz, distance_m"),
        ("return 100.0", r"gave one number for \(3,\) of distance_m"),
        ("return path.distance_m[:2]", r"gave an array of float64 of shape \(2,\) for \(3,\)"),
        (
            "return np.log10(path.distance_m - 200.0)",
            "gave nan at distance_m 49.0306026885: has to be finite",
        ),
        (
            "return 60.0 if path.distance_m > 100.0 else path.distance_m",
            r"wrong\.py:7: ValueError: The truth",
        ),
        ("return path.distance_m + np.random.default_rng().normal()", "gave something else for the same"),
        ("return 'far'", "gave 'far' for"),
        ("return -np.sqrt(path.distance_m)", "gave -10.53 dB at 110.9 m: a loss is positive"),
        ("return 50.0 * path.distance_m / path.distance_m.max()", "among other links, and 50 dB for that"),
    ],
)
def test_a_law_that_gives_no_losses_is_told_before_anything_flies(mine, body, problem):
    (mine / "models" / "wrong.py").write_text(
        f"import numpy as np\nfrom channel.variant import Variant\n\n\nclass Wrong(Variant):\n"
        f"    def path_loss_db(self, path):\n        {body}\n"
    )
    tree = {"preset": "perfect", "propagation": {"class": "models/wrong.py:Wrong"}}
    with (
        np.errstate(all="ignore"),
        pytest.raises(PresetError, match=f"wrong.py:Wrong.path_loss_db.*{problem}") as caught,
    ):
        presets.radio_from_mapping(presets.seen_from(mine, tree))
    assert caught.value.key.startswith("propagation")


@pytest.mark.parametrize("kind", ["propagation", "medium", "routing"])
@pytest.mark.parametrize(
    ("code", "problem"),
    [
        ("class Bad(Variant:", r"bad\.py:3: SyntaxError: invalid syntax"),
        ("import nowhere_to_be_found", r"bad\.py:3: ModuleNotFoundError: No module named"),
        ("raise SystemExit(3)", r"bad\.py:3: SystemExit: 3"),
        (
            "class Bad(Variant):\n    depth_m = 4.0",
            r"bad\.py:3: PydanticUserError: A non-annotated attribute",
        ),
        ("class Bad(Variant):\n    path: np.ndarray", r"bad\.py:3: PydanticSchemaGenerationError: Unable to"),
        (
            "class Bad(Variant):\n    depth_m: 'Depth' = 4.0\n" + METHODS,
            "PydanticUserError: `Bad` is not fully",
        ),
        (
            "class Bad(Variant):\n    @model_validator(mode='before')\n    @classmethod\n    def v(cls, value):\n"
            "        return value['no']\n" + METHODS,
            r"bad\.py:7: KeyError: 'no'",
        ),
    ],
)
def test_a_file_that_fails_as_it_is_loaded_is_told_in_a_line(mine, kind, code, problem):
    head = "import numpy as np; from pydantic import model_validator\nfrom channel.variant import Variant\n"
    (mine / "bad.py").write_text(head + code + "\n")
    tree = presets.seen_from(mine, {"preset": "perfect", kind: {"class": "bad.py:Bad"}})
    with pytest.raises(PresetError, match=problem) as caught:
        presets.radio_from_mapping(tree)
    assert caught.value.key.startswith(kind)
    assert "\n" not in str(caught.value)


def test_a_model_may_import_what_lies_beside_its_file(mine, monkeypatch):
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.delitem(sys.modules, "laws_base", raising=False)
    (mine / "models" / "laws_base.py").write_text("N = 7.0\n")
    (mine / "models" / "mine.py").write_text(f"from laws_base import N\n{CODE}".replace("4.0", "N"))
    config = presets.load_radio(
        "perfect", presets.seen_from(mine, {"propagation": {"class": "models/mine.py:Steep"}})
    )
    assert float(Radio(config).link(10.0).path_loss_db) == pytest.approx(70.0)


def test_a_law_that_does_not_hold_near_2_ghz_is_not_tried(mine):
    (mine / "models" / "low.py").write_text(
        "from channel.propagation.hata import OkumuraHata\n\n\nclass Low(OkumuraHata):\n    pass\n"
    )
    assert presets.radio_from_mapping(
        presets.seen_from(
            mine,
            {"preset": "telemetry-915", "propagation": {"class": "models/low.py:Low", "environment": "open"}},
        )
    )


def test_an_entry_point_gives_a_model_a_name(mine, monkeypatch):
    monkeypatch.syspath_prepend(mine / "models")
    point = importlib.metadata.EntryPoint("steep", "mine:Steep", "lostlink.propagation")
    monkeypatch.setattr(own, "_all_entry_points", lambda: importlib.metadata.EntryPoints([point]))
    own._entry_points.cache_clear()
    try:
        config = presets.load_radio("perfect", {"propagation": {"model": "steep", "exponent": 2.0}})
        assert float(Radio(config).link(1000.0).path_loss_db) == pytest.approx(60.0)
        assert "model: steep" in presets.radio_to_yaml(config)
    finally:
        own._entry_points.cache_clear()
        sys.modules.pop("mine", None)


def test_the_examples_do_what_they_say():
    radio = Radio(
        presets.load_radio(
            "perfect",
            {
                "frequency_hz": 1e9,
                "propagation": {"class": f"{EXAMPLE}:ThroughForest", "depth_m": 100.0},
                "antenna": {"class": f"{EXAMPLE}:Cardioid"},
                "error": {"class": f"{EXAMPLE}:Logistic", "half_db": 10.0},
            },
        )
    )
    ends = {"position_tx_ned_m": (0.0, 0.0, -40.0), "position_rx_ned_m": (300.0, 0.0, -40.0)}
    terms = {term.name: float(np.ravel(term.contribution)[0]) for term in radio.link(**ends).terms}
    assert terms["path_loss_db"] == pytest.approx(
        -(81.9904 + 1.33 * 100.0**0.588), abs=0.01
    )  # 20 log(4 pi 300 / 0.2998)
    assert terms["transmit_antenna_gain_db"] == 5.0
    assert terms["receive_antenna_gain_db"] == 5.0 - 20.0
    assert float(radio.per(10.0 + math.log(3.0), 40)) == pytest.approx(0.25)


def test_a_flat_earth_survives_being_written_down(tmp_path):
    flat = presets.load_radio("perfect", {"earth_radius_factor": None})
    (tmp_path / "flat.yaml").write_text(presets.radio_to_yaml(flat))
    assert presets.load_radio(tmp_path / "flat.yaml") == flat


def test_a_file_that_was_edited_is_read_again(mine):
    first = presets.load_radio(mine / "mine.yaml").propagation
    file = mine / "models" / "mine.py"
    file.write_text(CODE.replace("10.0 * self.exponent", "20.0 * self.exponent"))
    os.utime(file, ns=(1, 1))
    second = presets.load_radio(mine / "mine.yaml").propagation
    at = Radio(presets.load_radio("perfect")).path(10.0)
    assert float(second.path_loss_db(at)) == pytest.approx(2.0 * float(first.path_loss_db(at)))


def two_with_neighbours(tmp_path, *exponents):
    for folder, exponent in zip(("first", "second"), exponents, strict=True):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / f"near_{tmp_path.name}.py").write_text(f"EXPONENT = {exponent}\n")
        code = CODE.replace(
            "import numpy as np", f"import numpy as np\nfrom near_{tmp_path.name} import EXPONENT"
        )
        (tmp_path / folder / "mine.py").write_text(code.replace("4.0", "EXPONENT"))
    laws = ({"propagation": {"class": f"{tmp_path}/{each}/mine.py:Steep"}} for each in ("first", "second"))
    return [
        lambda law=law: Radio(presets.load_radio("perfect", law)).link(100.0).path_loss_db for law in laws
    ]


def test_what_lies_beside_one_file_is_not_taken_for_what_lies_beside_another(tmp_path):
    first, second = two_with_neighbours(tmp_path, 3.0, 5.0)
    assert first() == pytest.approx(60.0)
    told = r"second/mine\.py imports (near_\w+), and .*first/\1\.py has that name, too: rename it or .*second/\1\.py"
    with pytest.raises(PresetError, match=told):
        second()
    assert first() == pytest.approx(60.0)


def test_copies_of_one_file_may_lie_beside_two(tmp_path):
    assert [float(loss()) for loss in two_with_neighbours(tmp_path, 3.0, 3.0)] == pytest.approx([60.0, 60.0])
