"""The schema of a scenario file: what `Scenario` takes, and what a file may say besides.

A file may extend another and give parts only, write nodes as groups, and lay a radio or wind over a preset. An editor
finds less than `lostlink check`: a schema cannot know what else a file is laid over.
"""

from __future__ import annotations

import json
from collections.abc import Iterable

from pydantic import BaseModel

from bridge.scenario.document.extends import EXTENDS, WITHOUT, scenario_names
from bridge.scenario.expand.group_ids import COUNT, COUNT_MAX, PLACES
from bridge.scenario.expand.groups import EACH
from bridge.scenario.expand.patterns import PATTERNS
from bridge.scenario.model import Scenario
from bridge.scenario.schema.transform import (
    Schema,
    all_models,
    changed,
    of_parts,
    or_null,
    reference,
    renamed,
    schemas_of,
)
from channel.config import RadioConfig
from channel.own.models import CLASS_KEY, takes_own
from channel.presets import preset_names
from fdm.air.wind import WindConfig, wind_names
from fdm.model.airframe import airframe_names

DRAFT = "http://json-schema.org/draft-07/schema#"
FILE_NAME = "scenario.schema.json"
"""Where it ships, in sitl_configs."""
YAML_FILE: Schema = {"type": "string", "pattern": r"\.ya?ml$"}
PART, RADIO, WIND = "Part.", "Radio.", "Wind."
BY_INDEX = "ByIndex"
TRANSCEIVERS = ("Aircraft", "GroundNode")
NODES = {"ground": "GroundNode", "emitter": "EmitterNode"}
"""By kind; without one it is an aircraft."""
PLACE_OF = {"home": "HomePlace", "place": "GroundPlace"}
TAGS = ("type", "kind", "model")
ONE_EACH: Schema = {
    "type": "object",
    "required": [EACH],
    "properties": {EACH: {"type": "array", "minItems": 1}},
    "additionalProperties": False,
}
OWN: Schema = {"type": "object", "required": [CLASS_KEY]}
LEAVES = ("string", "number", "integer", "boolean")


def schema_text() -> str:
    """The schema as the file that ships."""
    return json.dumps(editor_schema(), indent=1, ensure_ascii=False) + "\n"


def editor_schema() -> Schema:
    """The JSON Schema (draft 7) of scenario files."""
    definitions = schemas_of(Scenario)
    scenario = definitions.pop(Scenario.__name__)
    _with_names(scenario, definitions)
    parts = {PART + name: _part_of(part, definitions) for name, part in definitions.items()}
    _with_groups(parts)
    patterns = {
        name: _part_of(part, {}) for model in PATTERNS.values() for name, part in schemas_of(model).items()
    }
    presets = _preset_schemas(RADIO, RadioConfig, preset_names()) | _preset_schemas(
        WIND, WindConfig, wind_names()
    )
    properties = scenario["properties"]
    part_of_scenario = _part_of(scenario, definitions)["properties"]
    lists = {"expectations": or_null(properties["expectations"])}  # a list takes the place of another, whole
    return {
        "$schema": DRAFT,
        "title": "lostlink scenario",
        "type": "object",
        "additionalProperties": False,
        "properties": _extending() | {key: {} for key in properties},
        "if": {"required": [EXTENDS]},
        "then": {"properties": {**part_of_scenario, **lists, "nodes": _nodes_laid_over()}},
        "else": {
            "required": scenario["required"],
            "not": {"required": [WITHOUT]},
            "properties": {**properties, "nodes": {**_nodes(), "minItems": 1}},
        },
        "definitions": definitions | parts | patterns | presets | {BY_INDEX: _by_index()},
    }


def _with_names(scenario: Schema, definitions: dict[str, Schema]) -> None:
    """Put the names of what ships where they may stand."""
    radio, wind = _setting(RADIO, RadioConfig, preset_names()), _setting(WIND, WindConfig, wind_names())
    for owner, key, schema in (
        (scenario, "radio", radio),
        (scenario, "wind", wind),
        *(
            (definitions[name], "radio", {"anyOf": [*radio["anyOf"], {"type": "null"}]})
            for name in TRANSCEIVERS
        ),
        (definitions["Aircraft"], "airframe", {"anyOf": [{"enum": airframe_names()}, YAML_FILE]}),
    ):
        words = {k: v for k, v in owner["properties"][key].items() if k in {"description", "default"}}
        owner["properties"][key] = schema | words


def _setting(prefix: str, model: type[BaseModel], names: Iterable[str]) -> Schema:
    return {"anyOf": [{"enum": list(names)}, YAML_FILE, reference(prefix + model.__name__)]}


def _preset_schemas(
    prefix: str, model: type[BaseModel], names: tuple[str, ...] | list[str]
) -> dict[str, Schema]:
    """A radio or wind spelt out: each group may be a part, be a class of one's own, or have its table in a file."""
    found: dict[str, Schema] = {
        name: or_null(changed(part, of_parts)) for name, part in schemas_of(model, prefix).items()
    }
    own = {
        (prefix + each.__name__, key)
        for each in all_models(model)
        for key, field in each.model_fields.items()
        if takes_own(field)
    }
    for name, part in found.items():
        part["patternProperties"] = {"_file$": {"type": "string"}}
        for key, below in part.get("properties", {}).items():
            if (name, key) in own:
                below = {**below, "anyOf": [*below["anyOf"], OWN]}
            part["properties"][key] = below if key in TAGS else changed(below, or_null)
    found[prefix + model.__name__]["properties"]["preset"] = {
        "anyOf": [{"enum": list(names)}, YAML_FILE],
        "description": "what the other keys change",
    }
    return found


def _part_of(schema: Schema, definitions: dict[str, Schema]) -> Schema:
    """A schema for parts of what it is for; single values may be texts that follow the index of a node."""
    part = changed(schema, of_parts)
    if "properties" in part:
        part["properties"] = {
            key: below if key in TAGS else changed(changed(below, _or_by_index), or_null)
            for key, below in part["properties"].items()
        }
    return renamed(or_null(part), {name: PART + name for name in definitions})


def _or_by_index(schema: Schema) -> Schema:
    if schema.get("type") not in LEAVES and "enum" not in schema:
        return schema
    words = {"description": schema["description"]} if "description" in schema else {}
    value = {key: part for key, part in schema.items() if key != "description"}
    return {"anyOf": [value, reference(BY_INDEX)], **words}


def _by_index() -> Schema:
    return {"anyOf": [{"type": "string", "pattern": r"\{.*\}"}, ONE_EACH]}


def _or_one_each(schema: Schema) -> Schema:
    """A schema of a list or mapping that takes a list of such as well, one for each node."""
    if reference(BY_INDEX) in schema.get("anyOf", []):
        return schema
    words = {"description": schema["description"]} if "description" in schema else {}
    return {"if": {"type": "object", "required": [EACH]}, "then": ONE_EACH, "else": schema, **words}


def _with_groups(parts: dict[str, Schema]) -> None:
    """Let parts of nodes be groups, with a count and a pattern."""
    for name in ("Aircraft", *NODES.values()):
        properties = parts[PART + name]["properties"]
        parts[PART + name]["required"] = ["id"]
        properties.update(
            {key: _or_one_each(part) for key, part in properties.items() if key not in {"id", *TAGS}}
        )
        parts[PART + name]["properties"][COUNT] = {
            "type": ["integer", "null"],
            "minimum": 0,
            "maximum": COUNT_MAX,
            "description": "so many nodes, whose ids count up; {i} is the index of each, from 0, and {n} the count",
        }
    for place in PLACES.values():
        for key, model in PATTERNS.items():
            words = f"a {key} of the nodes of a group"
            part = {"allOf": [reference(model.__name__)], "description": words}
            parts[PART + PLACE_OF[place]]["properties"][key] = part


def _nodes() -> Schema:
    """A list of nodes, or groups of them."""
    one, group = (_by_kind(prefix, reference(f"{prefix}Aircraft")) for prefix in ("", PART))
    return _list_of_nodes({"if": {"required": [COUNT]}, "then": group, "else": one})


def _nodes_laid_over() -> Schema:
    """A list of parts of nodes, or of groups: one without a kind has that of the node below."""
    aircraft, *others = (reference(PART + name) for name in ("Aircraft", *NODES.values()))
    is_word = {"properties": {"id": {"type": "string"}}, "required": ["id"]}
    unsaid = {"if": is_word, "then": {"anyOf": [aircraft, *others]}, "else": aircraft}
    return _list_of_nodes(_by_kind(PART, unsaid))


def _by_kind(prefix: str, unsaid: Schema) -> Schema:
    """A node of the kind that it says, ``unsaid`` if it says none."""
    schema = unsaid
    for kind, name in NODES.items():
        is_one = {"properties": {"kind": {"const": kind}}, "required": ["kind"]}
        schema = {"if": is_one, "then": reference(prefix + name), "else": schema}
    return schema


def _list_of_nodes(item: Schema) -> Schema:
    return {
        "type": "array",
        "items": item,
        "description": "what is on the air: UA, stations on the ground, emitters",
    }


def _extending() -> dict[str, Schema]:
    return {
        EXTENDS: {
            "anyOf": [{"enum": scenario_names()}, YAML_FILE],
            "description": "the scenario that this one is laid over: a file beside it, or one that ships",
        },
        WITHOUT: {"type": "array", "description": "ids of nodes of what is extended that are left out"},
    }
