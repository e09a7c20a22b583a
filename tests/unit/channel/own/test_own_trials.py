"""A user's models are tried when they are loaded, and what they give later names their class."""

import json
import re

import numpy as np
import pytest
from click.testing import CliRunner

from channel import presets
from channel.link.radio import Radio
from channel.medium.medium import Medium
from channel.own.methods import OwnModelError
from channel.presets import PresetError
from lostlink.cli.main import lostlink

HEAD = """
import numpy as np
from channel.fading.laws import CoherentFading
from channel.fading.shadowing import NormalShadowing
from channel.phy.error_model import UncodedAwgn
from channel.propagation.path_loss import FreeSpace
from channel.variant import Variant


"""
CLASS = {
    "error": """
class Own(UncodedAwgn):
    def {}
""",
    "bursts": """
class Own(Variant):
    mean_loss: object = {}
    def loss_at(self, words, times_ns): {}
""",
    "shadowing": """
class Own(NormalShadowing):
    def {}
""",
    "fading": """
class Own(CoherentFading):
    def gain_db(self, first, second, elevation_deg): {}
    def rule(self, elevation_deg, panels): {}
""",
    "noise": """
class Own(Variant):
    def noise_floor_dbm(self, bandwidth_hz, frequency_hz): {}
""",
    "antenna": """
class Own(Variant):
    needs_direction: bool = True
    def towards_db(self, direction_frd): {}
""",
    "propagation": """
class Own(FreeSpace):
    def path_loss_db(self, path):
        {}
""",
}
ONES = "return np.ones(times_ns.shape)"
NONE = "return np.zeros(times_ns.shape)"
RULE = "return np.zeros(1), np.ones(1)"


def own(tmp_path, kind, *bodies, **values):
    (tmp_path / "laws.py").write_text(HEAD + CLASS[kind].format(*bodies))
    return {"shadowing": {"model": "none"}, kind: {"class": f"{tmp_path}/laws.py:Own", **values}}


@pytest.mark.parametrize(
    ("kind", "bodies", "problem"),
    [
        ("error", ["per(self, s, n, b): return s * np.nan"], "per gave nan at snr_db -20: has to be from 0 to 1"),
        ("error", ["per(self, s, n, b): return s * 0 + 1.7"], "per gave 1.7 at snr_db -20"),
        ("error", ["per(self, s, n, b): return s * 0 - 0.7"], "per gave -0.7 at snr_db -20"),
        ("error", ["per(self, s, n, b): return 0.5"], r"per gave one number for \(5,\) of snr_db"),
        ("error", ["per(self, s): return s * 0"], r"per: TypeError: Own\.per\(\) takes 2 positional arguments"),
        ("error", ["ber(self, s, b): return s"], "ber gave -20 at snr_db -20"),
        ("bursts", [2.0, ONES], "mean_loss is 2.0: has to be from 0 to 1"),
        ("bursts", ["None", NONE], "mean_loss is None: has to be from 0 to 1"),
        ("bursts", [0.5, NONE], "mean_loss is 0.5, and loss_at gave 0 to 0"),
        ("bursts", [0.5, ONES], "mean_loss is 0.5, and loss_at gave 1 to 1"),
        ("bursts", [0.0, "return np.full(times_ns.shape, 0.5)"], "mean_loss is 0, and loss_at gave 0.5 to 0.5"),
        ("bursts", [0.5, "return words * 0.0 - 1.0"], "loss_at gave -1 at sim_time_ns"),
        ("shadowing", ["loss_db(self, z): return np.where(z > 2, np.nan, z)"], "loss_db gave nan at standard_normal 3"),
        ("shadowing", ["chance_below(self, loss_db): return loss_db"], "chance_below gave -3 at loss_db -3"),
        ("fading", ["return first * np.nan", RULE], "gain_db gave nan at first draw 0.001"),
        ("fading", ["return 0.0 * first", "return np.zeros(1)"], r"rule gave array\(\[0.\]\): has to give gains"),
        ("fading", ["return 0.0 * first", "return np.zeros(2), np.ones(2)"], "rule gave weights that are 2 together"),
        ("noise", ["return float('nan')"], "noise_floor_dbm gave nan at frequency_hz 2400000000"),
        ("noise", ["return np.zeros(3)"], r"noise_floor_dbm gave \(3,\) for \(\) of frequency_hz"),
        ("antenna", ["return direction_frd"], r"towards_db gave an array of float64 of shape \(5, 3\) for \(5,\) of"),
        ("antenna", ["return direction_frd[:, 0] / 0"], r"towards_db gave inf at direction_frd \[1. 0. 0.\]"),
        ("antenna", ["return np.random.default_rng().normal(size=5)"], "towards_db gave something else for the same"),
        ("propagation", ["return -super().path_loss_db(path)"], r"path_loss_db gave -80.95 dB at 110.9 m: a loss is"),
    ],
)  # fmt: skip
def test_each_kind_is_tried_when_it_is_loaded(tmp_path, kind, bodies, problem):
    values = {"sigma_db": 3.0} if kind == "shadowing" else {}
    with pytest.raises(PresetError, match=rf"{kind}: laws\.py:Own\.{problem}"):
        presets.load_radio("corrected", own(tmp_path, kind, *bodies, **values))


@pytest.mark.parametrize(
    ("kind", "bodies"),
    [
        ("bursts", [0.03, NONE]),  # what is rare may not be seen
        ("antenna", ["return 3.0"]),
        ("antenna", ["return np.full(direction_frd.shape[:-1], -np.inf)"]),
        ("fading", ["return np.where(first < 0.2, -np.inf, 0.0)", "return [-np.inf, 0.0], [0.2, 0.8]"]),
    ],
)
def test_what_a_kind_may_give_is_taken(tmp_path, kind, bodies):
    assert presets.load_radio("corrected", own(tmp_path, kind, *bodies))


GIVES_LATER = [
    ("propagation", ["return np.where(abs(path.distance_m - 930) < 25, np.nan, super().path_loss_db(path))"],
     "path_loss_db gave nan at distance_m 930: has to be finite"),
    ("antenna", ["return np.where(direction_frd.shape[0] == 5, 0.0, np.nan * direction_frd[..., 0])"],
     r"towards_db gave nan at direction_frd \[1. 0. 0.\]: has to be a number"),
    ("fading", ["return np.where(first.size == 5, 0.0, np.nan) + 0.0 * first", RULE],
     r"gain_db gave nan at first draw 0\.\d+: has to be a number"),
    ("shadowing", ["loss_db(self, z): return np.where(np.size(z) == 5, z, np.nan)"],
     r"loss_db gave nan at standard_normal -?\d\.\d+: has to be finite"),
    ("error", ["per(self, s, n, b): return np.where((s > 10.9) & (s < 60), np.nan, 0.0 * s)"],
     r"per gave nan at snr_db 11: has to be from 0 to 1"),
    ("bursts", [0.5, "return np.where(times_ns == 5, 1.5, times_ns % 2)"], "loss_at gave 1.5 at sim_time_ns 5"),
    ("propagation", ["if (path.distance_m == 930).any(): raise RuntimeError('no way')\n"
                     "        return super().path_loss_db(path)"],
     r"path_loss_db: .*laws\.py:13: RuntimeError: no way"),
]  # fmt: skip


@pytest.mark.parametrize(("kind", "bodies", "problem"), GIVES_LATER)
def test_what_it_gives_later_names_its_class(tmp_path, kind, bodies, problem):
    values = {"sigma_db": 3.0} if kind == "shadowing" else {}
    radio = Radio(presets.load_radio("corrected", own(tmp_path, kind, *bodies, **values)))
    medium = Medium(radio, seed=3, nodes=("a", "b"))
    medium.place("a", (0.0, 0.0, -40.0))
    medium.place("b", (930.0, 0.0, -40.0))
    medium.send(medium.packets(tx="a", seq=0, length_bytes=40, sim_time_ns=np.array([5])))
    with pytest.raises(OwnModelError, match=rf"^laws\.py:Own\.{problem}"):
        medium.settle()


@pytest.mark.parametrize(
    ("kind", "bodies", "line"),
    [
        ("propagation", ["path.distance_m[path.distance_m < 150.0] = 150.0"], 13),
        ("shadowing", ["loss_db(self, z):\n        z *= 3.0\n        return z"], 13),
        ("fading", ["return np.log(first, out=first)", RULE], 12),
        ("antenna", ["direction_frd[..., 2] = 0.0"], 13),
    ],
)
def test_what_it_is_given_is_to_be_read_only(tmp_path, kind, bodies, line):
    values = {"sigma_db": 3.0} if kind == "shadowing" else {}
    for _ in range(2):  # and the links with which models are tried stay as they are
        with pytest.raises(PresetError, match=rf"laws\.py:{line}: ValueError: .* is read-only"):
            presets.load_radio("corrected", own(tmp_path, kind, *bodies, **values))


@pytest.mark.parametrize(
    "body",
    [
        "return np.full(path.distance_m.shape, 103.25, dtype=np.float32)",
        "return [103.25 for _ in path.distance_m]",
        "return np.full(path.distance_m.shape, 103.25).astype(object)",
        "return np.ma.masked_less(np.full(path.distance_m.shape, 103.25), 0.0)",
    ],
)
def test_numbers_of_any_real_type_count_as_float64(tmp_path, body):
    radio = Radio(presets.load_radio("corrected", own(tmp_path, "propagation", body)))
    loss_db = radio.config.propagation.path_loss_db(radio.path([100.0, 500.0]))
    assert (type(loss_db), loss_db.dtype, loss_db.tolist()) == (np.ndarray, np.float64, [103.25, 103.25])
    assert radio.link([100.0, 500.0]).snr_db.dtype == np.float64


@pytest.mark.parametrize(
    ("body", "problem"),
    [
        ("return super().path_loss_db(path) + 0j", r"gave an array of complex128 of shape \(3,\)"),
        ("return super().path_loss_db(path).astype(str)", r"gave an array of <U\d+ of shape \(3,\)"),
        ("return np.ma.masked_greater(super().path_loss_db(path), 85.0)", r"gave nan at distance_m 1001\.15"),
    ],
)
def test_what_is_no_real_number_is_told(tmp_path, body, problem):
    with pytest.raises(PresetError, match=rf"laws\.py:Own\.path_loss_db {problem}"):
        presets.load_radio("corrected", own(tmp_path, "propagation", body))


KEEPS = """
from functools import cached_property
import numpy as np
from channel.variant import Variant
from pydantic import PrivateAttr


class Keeps(Variant):
    exponent: float = 4.0
    ends_m: float = float("nan")
    _decades: np.ndarray = PrivateAttr(default_factory=lambda: np.linspace(0.0, 7.0, 71))

    @cached_property
    def losses_db(self):
        return 10.0 * self.exponent * self._decades

    def path_loss_db(self, path):
        return np.interp(np.log10(path.distance_m), self._decades, self.losses_db)
"""


def test_models_that_keep_arrays_are_equal_by_their_parameters(tmp_path):
    (tmp_path / "laws.py").write_text(KEEPS)

    def radio(**parameters):
        law = {"class": f"{tmp_path}/laws.py:Keeps", **parameters}
        return Radio(presets.load_radio("corrected", {"propagation": law}))

    one, same, other = radio(), radio(), radio(exponent=3.0)
    assert one.config == same.config
    assert hash(one.config) == hash(same.config)
    assert one.config != other.config
    medium = Medium({"a": one, "b": same, "c": other}, seed=3, nodes=("a", "b", "c"))
    for node, north_m in zip("abc", (0.0, 100.0, 200.0), strict=True):
        medium.place(node, (north_m, 0.0, -40.0))
    medium.send(medium.packets(tx="a", seq=0, length_bytes=40))
    assert np.isfinite(medium.settle().received_power_dbm).all()


FIELDS = """
from channel.fading.laws import CoherentFading
from channel.fading.shadowing import NormalShadowing, PerPacketShadowing
from channel.propagation.path_loss import FreeSpace, PathLossModel
from pydantic import Field


class Ground(PathLossModel):
    has_ground: bool = True

    def path_loss_db(self, path):
        return FreeSpace().path_loss_db(path)


class Lasting(PerPacketShadowing):
    sigma_db: float = 6.0
    decorrelation_m: float = Field(default=30.0, ge=0.0)
    surroundings: str = "own"
    shared_ends: float = 0.0
    max_gain_db: float = 50.0
    spread_db = property(lambda self: self.sigma_db if self.sigma_db else self.sigma)

    def loss_db(self, standard_normal):
        return -self.sigma_db * standard_normal

    def chance_below(self, loss_db):
        return NormalShadowing(sigma_db=self.sigma_db).chance_below(loss_db)
"""


def lasting(tmp_path, **values):
    (tmp_path / "laws.py").write_text(FIELDS)
    law = {"class": f"{tmp_path}/laws.py:Lasting", **values}
    return presets.load_radio("wifi-2.4", {"shadowing": law, "fading": {"model": "none"}})


@pytest.mark.filterwarnings("ignore:Field name:UserWarning")
def test_a_field_counts_before_what_a_base_has_under_its_name(tmp_path):
    config = lasting(tmp_path)
    assert (
        config.shadowing.decorrelation_m,
        lasting(tmp_path, decorrelation_m=9.0).shadowing.decorrelation_m,
    ) == (30, 9)
    ours = {"model": "gudmundson", "sigma_db": 6.0, "decorrelation_m": 30.0, "surroundings": "own"}
    ours |= {"shared_ends": 0.0}
    powers = []
    for radio in (config, presets.load_radio("wifi-2.4", {"shadowing": ours, "fading": {"model": "none"}})):
        medium = Medium(Radio(radio), seed=3, nodes=("a", "b"))
        medium.place("a", (0.0, 0.0, -40.0))
        medium.place("b", (100.0, 0.0, -40.0))
        medium.send(medium.packets(tx="a", seq=range(9), length_bytes=40))
        powers.append(medium.settle().received_power_dbm)
    assert len(set(powers[0])) == 1
    assert np.array_equal(*powers)
    ground = {"propagation": {"class": f"{tmp_path}/laws.py:Ground"}}
    assert presets.load_radio("wifi-2.4", ground).propagation.has_ground is True


@pytest.mark.filterwarnings("ignore:Field name:UserWarning")
@pytest.mark.parametrize(
    ("values", "problem"),
    [
        (
            {"decorrelation_m": 0.0},
            r"laws\.py:Lasting\.decorrelation_m is 0\.0: has to be a number from 0\.001",
        ),
        ({"surroundings": "all"}, r"laws\.py:Lasting\.surroundings is 'all': has to be own or shared"),
        ({"shared_ends": 0.6}, r"laws\.py:Lasting\.shared_ends is 0\.6: has to be a number from 0 to 0\.5"),
        ({"sigma_db": 0.0}, r"laws\.py:21: AttributeError: 'Lasting' object has no attribute 'sigma'"),
    ],
)
def test_what_a_shadowing_says_of_its_extent_is_looked_at(tmp_path, values, problem):
    with pytest.raises(PresetError, match=f"shadowing: .*{problem}"):
        lasting(tmp_path, **values)


@pytest.mark.parametrize(
    ("more", "problem"),
    [
        ("def gain_of_scatter_db(self, s, d, e): return np.nan * s.real", "gain_of_scatter_db gave nan at"),
        ("def gain_of_scatter_db(self, s): return s.real", "gain_of_scatter_db: TypeError: .* positional arguments"),
        ("max_gain_db = property(lambda self: 'x')", "max_gain_db is 'x': has to be a number"),
    ],
)  # fmt: skip
def test_what_a_fading_may_have_is_looked_at(tmp_path, more, problem):
    fading = own(tmp_path, "fading", "return 0.0 * first", f"{RULE}\n    {more}")
    with pytest.raises(PresetError, match=rf"fading: laws\.py:Own\.{problem}"):
        presets.load_radio("corrected", fading)


def test_link_and_check_name_the_class(tmp_path):
    settings = own(tmp_path, GIVES_LATER[0][0], *GIVES_LATER[0][1])["propagation"]
    told = "laws.py:Own.path_loss_db gave nan at distance_m 9"
    link = [
        "link",
        "--radio",
        "corrected",
        "--ground-distance",
        "930",
        "--set",
        f"propagation={json.dumps(settings)}",
    ]
    radio = json.dumps({"preset": "corrected", "propagation": settings})
    for command in (link, ["check", "--set", f"radio={radio}"]):
        done = CliRunner().invoke(lostlink, command)
        assert (done.exit_code, told in done.output) == (2, True), done.output
        assert "Traceback" not in done.output


def test_noise_that_the_radios_own_carrier_makes_none_is_a_mistake_of_the_scenario(tmp_path):
    settings = own(tmp_path, "noise", "return -90.0 if frequency_hz == 2.4e9 else np.nan")
    radio = json.dumps({"preset": "corrected", **settings})
    done = CliRunner().invoke(lostlink, ["check", "--set", f"radio={radio}"])
    assert done.exit_code == 2
    assert "laws.py:Own.noise_floor_dbm gave nan at frequency_hz 2412000000" in done.output


@pytest.mark.parametrize(
    "body",
    [
        "return 60.0 + 200.0 * (path.distance_m.size == 60) + 0.0 * path.distance_m",
        "if (path.distance_m > 9e5).any(): raise RuntimeError('too far')\n        return super().path_loss_db(path)",
    ],
)
def test_check_ends_in_order_with_a_law_that_hangs_on_how_many_links_there_are_or_raises(tmp_path, body):
    settings = own(tmp_path, "propagation", body)
    done = CliRunner().invoke(
        lostlink, ["check", "--set", f"radio={json.dumps({'preset': 'corrected', **settings})}"]
    )
    assert "Traceback" not in done.output
    assert done.exception is None or isinstance(done.exception, SystemExit)
    assert (done.exit_code == 2) == ("raise" in body)
    assert ("RuntimeError: too far" in done.output) == ("raise" in body)
    assert re.search(r"laws\.py:Own\.path_loss_db", done.output) or "raise" not in body


FLAGS = """
from typing import ClassVar

import numpy as np
from channel.propagation.path_loss import PathLossModel
from channel.variant import Variant


class Plain(Variant):
    {flags}
    def path_loss_db(self, path):
        return 40.0 * np.log10(path.distance_m)


class Derived(PathLossModel):
    {flags}
    def path_loss_db(self, path):
        return 40.0 * np.log10(path.distance_m)


class Lacking(PathLossModel):
    pass
"""


@pytest.mark.parametrize("name", ["Plain", "Derived"])
@pytest.mark.parametrize(
    ("flags", "flag"),
    [
        ("pass", ""),
        ("has_ground: ClassVar[bool] = True", "has_ground"),
        ("has_earth: ClassVar[bool] = True", "has_earth"),
    ],
)
def test_a_law_has_the_flags_of_its_kind_whether_it_is_derived_or_not(tmp_path, name, flags, flag):
    (tmp_path / "laws.py").write_text(FLAGS.format(flags=flags))
    law = presets.load_radio("perfect", {"propagation": {"class": f"{tmp_path}/laws.py:{name}"}}).propagation
    known = ("needs_places", "needs_roles", "by_rays", "has_ground", "has_earth", "draws_sight", "has_sigmas")
    assert [each for each in known if getattr(law, each)] == ([flag] if flag else [])


def test_a_flag_may_be_a_field_of_a_law_that_is_not_derived(tmp_path):
    (tmp_path / "laws.py").write_text(
        FLAGS.format(flags="needs_places: bool = True").replace("Derived(Path", "D(Path")
    )
    (tmp_path / "laws.py").write_text((tmp_path / "laws.py").read_text().partition("class D(")[0])
    assert presets.load_radio(
        "perfect", {"propagation": {"class": f"{tmp_path}/laws.py:Plain"}}
    ).propagation.needs_places


def test_a_law_that_only_derives_lacks_its_loss(tmp_path):
    (tmp_path / "laws.py").write_text(FLAGS.format(flags="pass"))
    with pytest.raises(PresetError, match=r"Lacking in .* has no path_loss_db"):
        presets.load_radio("perfect", {"propagation": {"class": f"{tmp_path}/laws.py:Lacking"}})


OPENED = """
from channel.access.settings.base import Serial
from channel.routing.router import Forwarding, HopRouter
from channel.variant import Variant


class Way(Variant):
    def open({given}):
        return {gives}


class Air(Serial):
    def open({given}):
        return {gives}
"""


@pytest.mark.parametrize(
    ("kind", "name", "of"), [("routing", "Way", "HopRouter"), ("medium", "Air", "AccessMedium")]
)
@pytest.mark.parametrize(
    ("given", "gives", "problem"),
    [
        ("self, *given", "None", "gave None: has to give a subclass of {of}"),
        ("self", "None", "open: TypeError: {name}.open() takes 1 positional argument"),
    ],
)
def test_what_opens_a_medium_or_routing_has_to_give_one(tmp_path, kind, name, of, given, gives, problem):
    (tmp_path / "laws.py").write_text(OPENED.format(given=given, gives=gives))
    radio = {
        "preset": "telemetry-915",
        "medium": {"model": "airtime"},
        kind: {"class": f"{tmp_path}/laws.py:{name}"},
    }
    done = CliRunner().invoke(lostlink, ["check", "--set", f"radio={json.dumps(radio)}"])
    assert done.exit_code == 2
    assert f"laws.py:{name}.open" in done.output
    assert problem.format(of=of, name=name) in done.output
    assert "Traceback" not in done.output


def test_a_routing_of_ones_own_needs_no_copies(tmp_path):
    (tmp_path / "laws.py").write_text(
        OPENED.format(given="self, nodes, draws", gives="HopRouter(tuple(nodes), draws, Forwarding())")
    )
    routing = {"class": f"{tmp_path}/laws.py:Way"}
    config = presets.load_radio("telemetry-915", {"medium": {"model": "airtime"}, "routing": routing})
    assert config.routing.copies(7) == 1
    radio = {"preset": "telemetry-915", "medium": {"model": "airtime"}, "routing": routing}
    done = CliRunner().invoke(lostlink, ["check", "--set", f"radio={json.dumps(radio)}"])
    assert done.exit_code == 0, done.output


def test_link_and_check_name_the_laws(tmp_path):
    settings = own(tmp_path, "propagation", "return super().path_loss_db(path)")
    told = "propagation laws.py:Own, noise thermal, error uncoded-awgn, antenna isotropic"
    link = ["link", "--radio", "corrected", "--ground-distance", "400"]
    link += [f"--set={key}={json.dumps(value)}" for key, value in settings.items()]
    radio = json.dumps({"preset": "corrected", **settings})
    for command in (link, ["check", "--set", f"radio={radio}"]):
        assert told in CliRunner().invoke(lostlink, command).output


def test_a_property_that_raises_is_told_with_its_line(tmp_path):
    settings = own(tmp_path, "shadowing", "loss_db(self, z): return z", sigma_db=3.0)
    with (tmp_path / "laws.py").open("a") as file:
        file.write("    @property\n    def is_random(self): return 1 / 0\n")
    with pytest.raises(PresetError, match=r"shadowing: .*laws\.py:14: ZeroDivisionError: division by zero"):
        presets.load_radio("corrected", settings)


@pytest.mark.parametrize(
    "body",
    [
        "per(self, s, n, b): return self.ber(b=b, s=s)\n    def ber(self, s, b): return 0.0 * s",
        "per(self, s, n, b): return self.ber(s, b, 1.0)\n    def ber(self, s, b, c=0.0): return 0.0 * s + c",
        "per(self, s, n, b): return 0.0 * self.ber(s)\n    def ber(self, s, b=None): return 0.0 * s",
        "per(self, s, n, b): return 0.0 * s + np.nextafter(1.0, 2.0)",
        "per(self, s, n, b): return 0.0 * s - 1e-17",
    ],
)  # fmt: skip
def test_a_model_may_call_itself_as_it_likes_and_round(tmp_path, body):
    config = presets.load_radio("corrected", own(tmp_path, "error", body))
    assert Radio(config).probability_of_delivery(np.array([100.0])).shape == (1,)


@pytest.mark.parametrize("beyond", [1.0 + 2e-9, -2e-9])
def test_what_is_more_than_rounding_is_refused_in_all_its_digits(tmp_path, beyond):
    told = re.escape(f"per gave {beyond:.12g} at snr_db -20: has to be from 0 to 1")
    with pytest.raises(PresetError, match=told):
        presets.load_radio(
            "corrected", own(tmp_path, "error", f"per(self, s, n, b): return 0.0 * s + {beyond}")
        )
