"""Agents of the user's own are found by file or module, and what is wrong with them is said."""

from __future__ import annotations

import re
import sys
from math import inf
from pathlib import Path

import pytest

from bridge.agents import Agent, OwnCodeError, agent_class
from bridge.agents.own import load_class
from bridge.scenario.agents import OwnAgent
from bridge.scenario.file import SCENARIOS, ScenarioError, parse_scenario
from bridge.scenario.own.own_class import mistake_in

TEXT = (SCENARIOS / "separation.yaml").read_text(encoding="utf-8")
VALUES = "{limits_m: [.inf, -.inf, 1.5], names: {a: null, b: x}, quick: true}"
OWN = """\
from bridge.agents import Agent
from own_constants import VALUE

class Own(Agent):
    value = VALUE

class Other:
    pass
"""


@pytest.fixture
def agent_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A file with an agent, which imports another file beside it."""
    monkeypatch.setattr(sys, "path", [*sys.path])
    for module in ("own_agent", "own_constants"):
        monkeypatch.delitem(sys.modules, module, raising=False)
    (tmp_path / "own_constants.py").write_text("VALUE = 5\n")
    path = tmp_path / "own_agent.py"
    path.write_text(OWN)
    return path


def test_agent_in_a_file_may_import_what_lies_beside_it(agent_file: Path) -> None:
    found = agent_class(OwnAgent(type="own", class_=f"{agent_file}:Own"))
    assert issubclass(found, Agent)
    assert found.value == 5  # type: ignore[attr-defined]


def test_agent_in_a_module() -> None:
    assert load_class("bridge.agents.shipped.still", "Still").__name__ == "Still"


@pytest.mark.parametrize(
    ("name", "says"), [("Nobody", "has no class Nobody"), ("Other", "no subclass of"), ("VALUE", "no class")]
)
def test_what_is_no_agent_is_refused(agent_file: Path, name: str, says: str) -> None:
    with pytest.raises(OwnCodeError, match=says):
        load_class(str(agent_file), name)


@pytest.mark.parametrize("name", ["bridge", "logging"])
def test_file_does_not_take_the_place_of_another_module(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.setattr(sys, "path", [*sys.path])
    before = sys.modules[name]
    (tmp_path / "own_constants.py").write_text("VALUE = 5\n")
    monkeypatch.delitem(sys.modules, "own_constants", raising=False)
    (tmp_path / f"{name}.py").write_text(OWN)
    assert load_class(f"{tmp_path}/{name}.py", "Own").value == 5  # type: ignore[attr-defined]
    assert sys.modules[name] is before


def test_each_ua_has_its_own_module_of_the_same_file(agent_file: Path) -> None:
    first, second = (load_class(str(agent_file), "Own") for _ in range(2))
    assert first is not second
    first.value = 7  # type: ignore[attr-defined]
    assert second.value == 5  # type: ignore[attr-defined]


def test_the_module_of_a_nodes_agent_has_its_name_whatever_was_loaded_before(agent_file: Path) -> None:
    names = [load_class(str(agent_file), "Own", node).__module__ for node in ("0", "gcs", "0")]
    assert names == [f"{agent_file.stem}__{node}" for node in ("0", "gcs", "0")]


def test_a_file_that_is_loaded_for_no_node_takes_no_nodes_name(agent_file: Path) -> None:
    """As for what a study measures, in the process that has flown."""
    others = [load_class(str(agent_file), "Own").__module__ for _ in range(2)]
    numbers = [name.rpartition("_")[2] for name in others]
    agents = [load_class(str(agent_file), "Own", number).__module__ for number in numbers]
    assert len({*others, *agents}) == 4


def test_missing_module_is_named() -> None:
    with pytest.raises(OwnCodeError, match=r"no module nowhere\.to_be_found"):
        load_class("nowhere.to_be_found", "Own")


def test_options_reach_the_agents_process_as_they_are(tmp_path: Path) -> None:
    (tmp_path / "a.py").write_text("class B(Agent):\n  reads = ('limits_m', 'names', 'quick')\n")
    own = f"{{type: own, class: {tmp_path}/a.py:B, options: {VALUES}}}"
    text = TEXT.replace("{type: hold, altitude_m: 40}", own)
    scenario = parse_scenario(text, "my.yaml")
    agent = parse_scenario(scenario.to_yaml(), "resolved.yaml").ua[0].agent
    assert isinstance(agent, OwnAgent)
    assert agent.options == {"limits_m": [inf, -inf, 1.5], "names": {"a": None, "b": "x"}, "quick": True}


@pytest.mark.parametrize(
    ("agent", "key", "says"),
    [
        (
            "{type: own, class: a:B, options: {day: 2026-05-01}}",
            "nodes.0.agent.options.day",
            "not a valid JSON value",
        ),
        (
            "{type: own, class: a:B, options: {bytes: !!binary /w==}}",
            "nodes.0.agent.options.bytes",
            "not a valid JSON value",
        ),
        ("{type: own, class: nowhere.py:Own}", "nodes.0.agent.class", "nowhere.py: no such file"),
        ("{type: own, class: nowhere}", "nodes.0.agent.class", "FILE.py:NAME or package.module:NAME"),
        ("{type: own}", "nodes.0.agent.class", "is required"),
        ('{type: own, class: "a.py:1b"}', "nodes.0.agent.class", "'1b' is no name in Python"),
        (
            "{type: own, clas: a:B}",
            "nodes.0.agent.clas",
            "allowed here: isolated, type, class, has_task, options",
        ),
    ],
)
def test_mistake_is_told_with_its_place(agent: str, key: str, says: str) -> None:
    old = "{type: hold, altitude_m: 40}"
    assert old in TEXT
    with pytest.raises(ScenarioError) as caught:
        parse_scenario(TEXT.replace(old, agent), "my.yaml")
    assert f"my.yaml:{TEXT[: TEXT.index(old)].count(chr(10)) + 1}: {key}: " in str(caught.value)
    assert says in str(caught.value)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("class Other: ...", "has no class Own"),
        ("class Own(:", ":1: invalid syntax"),
        ("\0", "null bytes"),
        ("class Own: ...", "mine.py:1: Own is no subclass of bridge.agents.Agent"),
        ("class Own(Base): ...\nclass Base(dict, object): ...", ":1: Own is no subclass of"),
        ("def Own(ua, config, transmit): ...", ":1: Own is a function, and no class"),
        ("class Own(Agent):\n  async def fly(self):\n    yield 1", ":2: Own.fly has a yield, which makes it"),
        (
            "class Base(Agent):\n  async def fly(self):\n    yield\nclass Own(Base): ...",
            ":2: Own.fly has a yield",
        ),
        ("class Base(Agent):\n  def fly(self): ...\nclass Own(Base): ...", ":2: Own.fly is a plain def"),
        ("class Own(Agent):\n  async def fly(self):\n    def one(): yield 1", ""),
        ("class Own(Agent):\n  def fly(self): ...\n  fly = asynchronous(fly)", ""),
        ("class Base(Agent):\n  def fly(self): ...\nclass Own(Base):\n  async def fly(self): ...", ""),
        ("class Own: ...\nOwn = made(Own)", ""),
        ("@made\nclass Own: ...", ""),
        ("class Own(metaclass=Made): ...", ""),
        ("class Own(lib.Agent): ...", ""),
        ("class Own(make()): ...", ""),
        ("from agents import Exception\nclass Own(Exception): ...", ""),
        ("from agents import *\nclass Own(Exception): ...", ""),
        ("if True:\n  class Own: ...\nelse:\n  from agents import Own", ""),
        ("try:\n  from agents import Base\nexcept ImportError:\n  class Base: ...\nclass Own(Base): ...", ""),
        ("from somewhere import Own", ""),
        ("from somewhere import *", ""),
    ],
)
def test_file_is_looked_at_without_running_it(tmp_path: Path, text: str, says: str) -> None:
    (tmp_path / "mine.py").write_text(f"{text}\nraise SystemExit('it ran')\n")
    mistake = mistake_in(str(tmp_path / "mine.py"), "Own")
    assert says in mistake if says else mistake == ""


@pytest.mark.parametrize(("text", "says"), [("async def fly(self):\n    yield 1", "has a yield")])
def test_a_fly_that_yields_is_told_as_a_generator(tmp_path: Path, text: str, says: str) -> None:
    (tmp_path / "mine.py").write_text(f"from lostlink import Agent\nclass Own(Agent):\n  {text}\n")
    with pytest.raises(OwnCodeError, match=rf"Own\.fly in .*mine\.py {says}"):
        load_class(f"{tmp_path}/mine.py", "Own")


def test_any_name_of_python_names_a_class(tmp_path: Path) -> None:
    (tmp_path / "ägent.py").write_text(
        "from lostlink import Agent\nclass Ünï(Agent): ...\n", encoding="utf-8"
    )
    text = TEXT.replace("{type: hold, altitude_m: 40}", f'{{type: own, class: "{tmp_path}/ägent.py:Ünï"}}')
    agent = parse_scenario(text, "my.yaml").ua[0].agent
    assert isinstance(agent, OwnAgent)
    assert (agent.class_name, agent_class(agent).__name__) == ("Ünï", "Ünï")


def test_modules_of_one_name_beside_agents_of_two_folders_are_refused(tmp_path: Path) -> None:
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "mine.py").write_text("from lostlink import Agent\nclass Mine(Agent): pass\n")
        (tmp_path / folder / "util.py").write_text("")
    agents = [f"{{type: own, class: {tmp_path}/{folder}/mine.py:Mine}}" for folder in ("a", "b")]
    text = TEXT.replace("{type: hold, altitude_m: 40}", agents[0])
    text = text[: text.rindex("agent:")] + f"agent: {agents[1]}\n"
    with pytest.raises(ScenarioError, match="have one name, and UA may share a process"):
        parse_scenario(text, "my.yaml")
    (tmp_path / "b" / "util.py").rename(tmp_path / "b" / "other.py")
    assert len(parse_scenario(text, "my.yaml").ua) == 2


@pytest.mark.parametrize(
    ("base", "option", "says"),
    [
        ("Agent", "altitude_m", ""),
        ("Agent", "altitud_m", "does not read it; did you mean altitude_m?"),
        ("Agent", "colour", "does not read it$"),
        ("Agent", "beside_m", ""),
        ("somewhere.Patrol", "colour", ""),
        ("somewhere.Patrol", "altitud_m", "did you mean altitude_m?"),
    ],
)
def test_an_option_that_nobody_reads_is_a_mistake(tmp_path: Path, base: str, option: str, says: str) -> None:
    (tmp_path / "util.py").write_text("def height(beside_m): ...\n")
    code = f"import util\nclass Own({base}):\n    async def fly(self): self.options['altitude_m']\n"
    (tmp_path / "mine.py").write_text(code)
    agent = f"{{type: own, class: {tmp_path}/mine.py:Own, options: {{{option}: 4}}}}"
    text = TEXT.replace("{type: hold, altitude_m: 40}", agent)
    if not says:
        assert len(parse_scenario(text, "my.yaml").ua) == 2
        return
    with pytest.raises(
        ScenarioError, match=rf"my.yaml:\d+: nodes.0.agent.options.{option}: mine.py .*{says}"
    ):
        parse_scenario(text, "my.yaml")


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package on Python's path, which would end whoever runs it."""
    monkeypatch.syspath_prepend(tmp_path)
    folder = tmp_path / "flocking_here"
    folder.mkdir()
    (folder / "__init__.py").write_text("from .agent import Flock\nraise SystemExit('it ran')\n")
    code = (
        "from lostlink import Agent\nfrom .base import Base\nclass Flock(Base):\n    pass\nclass Other: ...\n"
    )
    (folder / "agent.py").write_text(code)
    base = (
        "from lostlink import Agent\nclass Base(Agent):\n    async def fly(self): self.options['radius_m']\n"
    )
    (folder / "base.py").write_text(base)
    return folder


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("flocking_here.agent:Flock", ""),
        ("flocking_here:Flock", ""),
        (
            "flocking_here.agnet:Flock",
            r"no module flocking_here\.agnet: .*; did you mean flocking_here\.agent\?",
        ),
        ("flocking_hree:Flock", r"no module flocking_hree: .*; did you mean flocking_here\?"),
        ("flocking_here.agent:Flok", r"agent\.py has no class Flok; did you mean Flock\?"),
        ("flocking_here:Flok", r"__init__\.py has no class Flok; did you mean Flock\?"),
        ("flocking_here.agent:Other", r"agent\.py:5: Other is no subclass"),
        ("collections.abc:Mapping", ""),
    ],
)
def test_a_module_is_looked_at_as_a_file_is(package: Path, name: str, says: str) -> None:
    mistake = mistake_in(*name.split(":"))
    assert re.search(says, mistake) if says else mistake == ""


@pytest.mark.parametrize("place", ["flocking_here", "flocking_here.agent", "shim.py"])
def test_options_are_looked_for_where_a_module_takes_its_class_from(package: Path, place: str) -> None:
    """In the package and its base class, not in the shim alone."""
    if place == "shim.py":
        place = f"{package.parent}/shim.py"
        Path(place).write_text("from flocking_here.agent import Flock\n")
    agent = f"{{type: own, class: '{place}:Flock', options: {{radius_m: 4, radus_m: 5, colour: 6}}}}"
    with pytest.raises(ScenarioError) as error:
        parse_scenario(TEXT.replace("{type: hold, altitude_m: 40}", agent), "my.yaml")
    assert [line.partition("options.")[2] for line in str(error.value).splitlines()] == [
        f"radus_m: {Path(place).name} does not read it; did you mean radius_m?",
        f"colour: {Path(place).name} does not read it",
    ]


def test_a_package_in_the_working_directory_is_told(
    package: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "path", [each for each in sys.path if each not in ("", str(tmp_path))])
    monkeypatch.chdir(tmp_path)
    assert f"lies in {tmp_path}, which is not on PYTHONPATH" in mistake_in("flocking_here.agent", "Flock")
