"""The schema that editors check scenario files by. The oracle is another reader of schemas, jsonschema."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import yaml
from click.testing import CliRunner
from jsonschema import Draft7Validator

from bridge.scenario.file import parse_scenario
from bridge.scenario.schema.editor import FILE_NAME
from lostlink.cli.flying.schema import schema as schema_command
from sitl_configs.yaml_text import yaml_of

ROOT = Path(__file__).parents[5] / "sitl_configs"
SHIPPED = json.loads((ROOT / FILE_NAME).read_text(encoding="utf-8"))
CHECKER = Draft7Validator(SHIPPED)
HEAD: dict[str, Any] = {
    "schema": 1,
    "name": "mine",
    "duration_s": 60,
    "origin": {"lat_deg": 47.4, "lon_deg": 8.5, "alt_amsl_m": 420},
    "radio": "moon2020",
}
STILL = {"id": 0, "agent": {"type": "still"}}


def mistakes(content: dict[str, Any]) -> list[str]:
    return [error.message for error in CHECKER.iter_errors(content)]


EXAMPLES = ROOT.parent / "examples"
FOLDERS = (ROOT / "scenarios", *(EXAMPLES / name for name in ("agents", "ground_nodes", "scenarios")))
FILES = [file for folder in FOLDERS for file in sorted(folder.glob("*.yaml"))]


def test_the_shipped_schema_is_fresh_and_a_schema() -> None:
    """`make schema` writes it anew."""
    done = CliRunner().invoke(schema_command)
    assert done.output == (ROOT / FILE_NAME).read_text(encoding="utf-8")
    Draft7Validator.check_schema(SHIPPED)


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_what_ships_is_right_and_names_the_schema(file: Path) -> None:
    text = file.read_text(encoding="utf-8")
    assert mistakes(yaml.safe_load(text)) == []
    first, _, named = text.splitlines()[0].partition("$schema=")
    assert first == "# yaml-language-server: "
    assert (file.parent / named).resolve() == ROOT / FILE_NAME


@pytest.mark.parametrize(
    "change",
    [
        {"wind": "breeze"},
        {"wind": {"preset": "gusty", "constant": {"from_deg": 90}}},
        {"radio": "mine.yaml"},
        {
            "radio": {
                "preset": "moon2020",
                "noise": {"floor_dbm": -330},
                "antenna": {"class": "a.py:A", "gain": 2},
            }
        },
        {"radio": {"preset": "corrected", "error": {"model": "snr-table", "table_file": "loss.csv"}}},
        {"speed": "max", "hosts": "per-ua"},
        {
            "nodes": [
                STILL,
                {**STILL, "id": "gcs", "kind": "ground", "radio": "disk"},
                {**STILL, "id": 3, "radio": None},
            ]
        },
        {"nodes": [{"id": 0, "count": 6, "home": {"ring": {"radius_m": 9}}, "agent": {"type": "still"}}]},
        {
            "nodes": [
                {**STILL, "count": 6, "home": {"ring": {"radius_m": "{9 * n}", "face": {"each": ["along"]}}}}
            ]
        },
        {
            "nodes": [
                {
                    "id": 0,
                    "count": 6,
                    "airframe": {"each": ["f450", "hexa550"]},
                    "agent": {"type": "hold", "altitude_m": "{30 + i}"},
                }
            ]
        },
        {"nodes": [STILL, {"id": 7, "kind": "emitter", "frequency_hz": 2.4e9, "power_dbm": 20}]},
        *(
            {"nodes": [{**STILL, "count": 2, key: {"each": values}}]}
            for key, values in {
                "agent": [{"type": "still"}, {"type": "hold", "altitude_m": 40}],
                "home": [{"north_m": 0}, {"north_m": 9}],
                "networks": [["main"], None],
                "groups": [["a"], ["a", "b"]],
                "radio_off": [[], [{"from_s": 3}]],
                "sensor": [{}, None],
            }.items()
        ),
        {"expectations": [{"type": "age", "node": 0, "at_most_s": 3}, {"type": "host_losses"}]},
        {"nodes": [STILL, {**STILL, "id": 1}], "partitions": [{"groups": [[0], ["1"]], "from_s": 3}]},
    ],
)
def test_what_is_right_is_taken(change: dict[str, Any]) -> None:
    assert mistakes(HEAD | {"nodes": [STILL]} | change) == []
    if "mine.yaml" not in str(change) and "a.py" not in str(change) and "loss.csv" not in str(change):
        parse_scenario(yaml_of(HEAD | {"nodes": [STILL]} | change), "mine")


@pytest.mark.parametrize(
    "content",
    [
        {"extends": "separation"},
        {"extends": "base.yaml", "without": [1], "nodes": [{"id": 0, "agent": {"altitude_m": 9}}]},
        {
            "extends": "base.yaml",
            "nodes": [{"id": "gcs", "place": {"north_m": 3}}, {"id": "jam", "duty": 0.5}],
        },
        {"extends": "base.yaml", "nodes": [{"id": "{i + 4}", "count": 2, "airframe": "f450"}]},
        {"extends": "base.yaml", "nodes": [{"id": 0, "count": 9}], "origin": {"lat_deg": 3}},
        {
            "extends": "base.yaml",
            "wind": None,
            "ports": {"zenoh": None},
            "nodes": [{"id": 0, "count": None, "home": {"ring": None}}],
        },
        {
            "extends": "base.yaml",
            "nodes": [{"id": 0, "home": {"ring": {"face": "inward"}}}],
            "expectations": None,
        },
        {"extends": "base.yaml", "radio": {"noise": None, "fading": {"k_db": None}}, "weather": None},
    ],
)
def test_parts_may_be_laid_over_another(content: dict[str, Any]) -> None:
    assert mistakes(content) == []


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"sead": 1}, "'sead' was unexpected"),
        ({"speed": "fast"}, "'fast' is not valid"),
        ({"origin": {"lat_deg": 3}}, "'lon_deg' is a required property"),
        ({"nodes": []}, "[] should be non-empty"),
        ({"nodes": [{"id": 0}]}, "'agent' is a required property"),
        ({"nodes": [{**STILL, "hme": {}}]}, "'hme' was unexpected"),
        ({"nodes": [{**STILL, "agent": {"type": "hold"}}]}, "is not valid under any of the given schemas"),
        ({"nodes": [{**STILL, "count": 2, "home": {"rnig": {}}}]}, "'rnig' was unexpected"),
        ({"nodes": [{**STILL, "count": 2, "home": {"each": []}}]}, "[] should be non-empty"),
        (
            {"nodes": [{**STILL, "count": 2, "home": {"each": [{}], "north_m": 3}}]},
            "'north_m' was unexpected",
        ),
        ({"nodes": [{**STILL, "home": {"each": [{}]}}]}, "'each' was unexpected"),
        ({"radio": {"preset": "moon2020", "nose": {}}}, "is not valid under any of the given schemas"),
        ({"radio": {"atmosphere": {"class": "a.py:A"}}}, "is not valid under any of the given schemas"),
        ({"radio": {"length": {"class": "a.py:A"}}}, "is not valid under any of the given schemas"),
        ({"radio": {"polarisation": {"class": "a.py:A"}}}, "is not valid under any of the given schemas"),
        ({"wind": {"constant": {"speed": 3}}}, "is not valid under any of the given schemas"),
        ({"without": [1]}, "should not be valid under"),
    ],
)
def test_what_is_wrong_is_marked(change: dict[str, Any], says: str) -> None:
    assert any(says in text for text in mistakes(HEAD | {"nodes": [STILL]} | change))


@pytest.mark.parametrize(
    "key",
    [
        "propagation",
        "shadowing",
        "fading",
        "noise",
        "bursts",
        "error",
        "antenna",
        "receive_antenna",
        "medium",
        "routing",
    ],
)
def test_a_class_may_stand_where_the_program_takes_one(key: str) -> None:
    assert (
        mistakes(HEAD | {"nodes": [STILL], "radio": {key: {"class": "mine.py:Mine", "depth_m": 3.0}}}) == []
    )
