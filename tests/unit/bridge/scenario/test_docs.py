"""What docs/reference/scenario.md says: its scenarios are right, its tables have all keys, its examples are there."""

from __future__ import annotations

import re
from pathlib import Path
from textwrap import dedent

import pytest
import yaml

from bridge.scenario.document.settings import parse_setting
from bridge.scenario.expand.patterns import PATTERNS
from bridge.scenario.file import parse_scenario, read_scenario
from bridge.scenario.model import Scenario
from bridge.scenario.schema.editor import editor_schema
from lostlink.plan.plan import plan_of

ROOT = Path(__file__).parents[4]
TEXT = (ROOT / "docs" / "reference" / "scenario.md").read_text(encoding="utf-8")
HEAD = """\
schema: 1
name: mine
duration_s: 60
origin: {lat_deg: 40.1331, lon_deg: -105.2404, alt_amsl_m: 1690}
radio: moon2020
"""
NODES = """\
nodes:
  - {id: 0, agent: {type: still}}
  - {id: 1, agent: {type: still}}
"""


def block(begin: str) -> str:
    """The indented block that begins so."""
    lines = TEXT.split(f"    {begin}", 1)[1].splitlines()
    taken = [begin.replace("\n    ", "\n") + lines[0]]
    for line in lines[1:]:
        if line and not line.startswith("    "):
            break
        taken.append(line[4:])
    return "\n".join(taken) + "\n"


def test_the_first_scenario_is_right() -> None:
    assert len(parse_scenario(block("schema: 1"), "docs").ua) == 2


def test_what_extends_is_right() -> None:
    it = parse_scenario(block("extends: separation"), "docs")
    assert [ua.id for ua in it.ua] == [1, 7]
    assert it.radio == "wifi-2.4"


def test_the_outages_are_right() -> None:
    first = "nodes:\n      - {id: 0, agent: {type: hold, altitude_m: 40}}\n      - {id: 1, radio_off"
    it = parse_scenario(HEAD + block(first), "docs")
    assert [(each.from_s, each.to_s) for each in it.ua[1].radio_off] == [(20, 30), (90, None)]


def test_the_partitions_are_right() -> None:
    nodes = "".join(f"  - {{id: {n}, groups: [squad-{n % 2}], agent: {{type: still}}}}\n" for n in range(3))
    gcs = "  - {id: gcs, kind: ground, agent: {type: still}}\n"
    it = parse_scenario(f"{HEAD}nodes:\n{nodes}{gcs}{block('partitions:')}", "docs")
    assert [it.nodes_apart(each) for each in it.partitions] == [
        (("0", "1"), ("2", "gcs")),
        (("0", "2"), ("1",)),
    ]


@pytest.mark.slow
def test_the_networks_are_right() -> None:
    """Radios of pairs would leave one of the three without a peer."""
    text = HEAD.replace("radio: moon2020\n", "") + block("radio: wifi-5.8\n    networks:")
    it = parse_scenario(text.replace('{type: own, class: "mine.py:Mine"}', "{type: still}"), "docs")
    assert [node.networks for node in it.nodes] == [None, ("main", "mesh"), ("main",)]
    assert not [line for line in plan_of(it).warnings if "no_peer" in line]


def test_the_mixed_fleet_of_the_page_on_px4_is_right() -> None:
    page = (ROOT / "docs" / "how-to" / "px4.md").read_text(encoding="utf-8")
    (fleet,) = re.findall(r"^    autopilot: px4\n(?:    .*\n)+", page, re.MULTILINE)
    it = parse_scenario(HEAD + dedent(fleet), "docs")
    assert [(ua.id, ua.autopilot) for ua in it.ua] == [(0, None), (1, None), (2, "ardupilot")]


def test_the_groups_are_right() -> None:
    it = parse_scenario(HEAD + block("nodes:\n      - id: 0"), "docs")
    assert len(it.ua) == 20
    assert [node.id for node in it.ground] == ["mast-0", "mast-1", "mast-2"]


def test_the_expectations_are_right() -> None:
    it = parse_scenario(HEAD + NODES + block("expectations:"), "docs")
    assert [each.type for each in it.expectations] == ["delivery", "position", "ending"]


def test_the_settings_are_right() -> None:
    texts = re.findall(r"--set ([\w.*]+=\S+?)[`\s]", TEXT.replace("'", ""))
    settings = [parse_setting(text) for text in texts if "{" not in text and not text.startswith("KEY=")]
    assert len(settings) >= 5
    read_scenario("separation", settings)


def test_all_keys_and_patterns_are_there() -> None:
    for key in Scenario.model_json_schema(by_alias=True)["properties"]:
        assert re.search(rf"\| .*`{key}[`.\[]", TEXT), key
    for name, pattern in PATTERNS.items():
        (row,) = re.findall(rf"\| `{name}` \|.*", TEXT)
        assert all(f"`{key}" in row for key in pattern.model_fields), name


@pytest.mark.parametrize(
    "kind",
    sorted(
        part["properties"]["type"]["const"]
        for name, part in editor_schema()["definitions"].items()
        if name.endswith("Expectation") and "." not in name
    ),
)
def test_all_keys_of_expectations_are_there(kind: str) -> None:
    (row,) = re.findall(rf"\| `{kind}` \|.*", TEXT)
    model = next(
        part
        for name, part in editor_schema()["definitions"].items()
        if name.endswith("Expectation") and part["properties"]["type"].get("const") == kind
    )
    assert all(f"`{key}" in row for key in model["properties"] if key not in {"type", "name"}), row


def test_every_example_is_there() -> None:
    for folder in ("agents", "ground_nodes", "scenarios"):
        named = set(re.findall(rf"\.\./examples/{folder}/(\w+)\.yaml", TEXT))
        assert named == {file.stem for file in (ROOT / "examples" / folder).glob("*.yaml")} != set()


def test_what_the_docs_say_of_mistakes() -> None:
    for line in block("lostlink: mine.yaml:4").splitlines():
        if line:
            assert re.match(r"lostlink: mine\.yaml:\d+: [\w.]+: unknown key; did you mean \w+\?", line)
    assert yaml.safe_load(block("# yaml-language-server")) is None
