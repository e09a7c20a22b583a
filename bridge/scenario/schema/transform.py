"""Changes to the JSON Schemas that pydantic makes: for older drafts, for parts of things, with words of help."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Mapping
from typing import Any

from pydantic import BaseModel

from sitl_configs.settings import models_in

Schema = dict[str, Any]
DEFINITIONS = "#/definitions/"


def schemas_of(model: type[BaseModel], prefix: str = "") -> dict[str, Schema]:
    """The schema of a model and those of all models in it, by name, in the words of draft 7."""
    whole = model.model_json_schema(by_alias=True)
    parts = whole.pop("$defs", {}) | {model.__name__: whole}
    words = {found.__name__: found for found in all_models(model)}
    found = {}
    for name, part in parts.items():
        if name in words:
            _describe(part, words[name])
        found[prefix + name] = _in_draft_7(part, prefix)
    return found


def all_models(model: type[BaseModel]) -> list[type[BaseModel]]:
    """A model and all models that its fields are made of, at any depth."""
    found: list[type[BaseModel]] = []
    waiting = [model]
    while waiting:
        here = waiting.pop()
        if here not in found:
            found.append(here)
            waiting += [m for field in here.model_fields.values() for m in models_in(field.annotation)]
    return found


def changed(schema: Any, change: Callable[[Schema], Schema]) -> Any:
    """A schema with each schema in it changed, the inner ones first."""
    if isinstance(schema, list):
        return [changed(each, change) for each in schema]
    if not isinstance(schema, dict):
        return schema
    inner = {
        key: {name: changed(each, change) for name, each in value.items()}
        if key in {"properties", "patternProperties"}
        else (changed(value, change) if key in {"anyOf", "oneOf", "items", "additionalProperties"} else value)
        for key, value in schema.items()
    }
    return change(inner)


def of_parts(schema: Schema) -> Schema:
    """A schema that takes a part of what it is for: what is laid over the rest of it, or below which it is laid."""
    out = {key: value for key, value in schema.items() if key not in {"required", "default"}}
    if "oneOf" in out:
        out["anyOf"] = out.pop("oneOf")
    return out


def or_null(schema: Schema) -> Schema:
    """A schema that takes null as well: laid over a key, it removes it."""
    out = dict(schema)
    if isinstance(schema.get("type"), str) and "const" not in schema:
        out["type"] = list(dict.fromkeys([schema["type"], "null"]))
    if "enum" in schema:
        out["enum"] = [*schema["enum"], None]
    return out


def renamed(schema: Schema, names: Mapping[str, str]) -> Schema:
    """A schema that refers to others by other names."""

    def change(part: Schema) -> Schema:
        name = str(part.get("$ref", "")).removeprefix(DEFINITIONS)
        return {**part, "$ref": DEFINITIONS + names[name]} if name in names else part

    out: Schema = changed(schema, change)
    return out


def reference(name: str) -> Schema:
    """A schema by name."""
    return {"$ref": DEFINITIONS + name}


def _describe(schema: Schema, model: type[BaseModel]) -> None:
    """Give a schema's properties the words of the model's docstring."""
    text = inspect.getdoc(model) or ""
    head, _, attributes = text.partition("\nAttributes:\n")
    schema["description"] = " ".join(head.split("\n\n")[0].split())
    aliases = {name: field.alias or name for name, field in model.model_fields.items()}
    for names, words in re.findall(
        r"^    ([\w, ]+): ((?:.+\n?)(?:        .+\n?)*)", attributes, re.MULTILINE
    ):
        for name in names.split(", "):
            part = schema.get("properties", {}).get(aliases.get(name, name))
            if part is not None:
                part.setdefault("description", " ".join(words.split()))


def _in_draft_7(schema: Schema, prefix: str) -> Schema:
    def change(part: Schema) -> Schema:
        out = {key: value for key, value in part.items() if key not in {"title", "discriminator"}}
        if "$ref" in out:
            out["$ref"] = DEFINITIONS + prefix + str(out["$ref"]).rpartition("/")[2]
        if "prefixItems" in out:
            out["items"] = [changed(each, change) for each in out.pop("prefixItems")]
        return out

    out: Schema = changed(schema, change)
    return out
