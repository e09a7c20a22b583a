"""The API's reference from its OpenAPI document: ``python -m aps.api.reference`` writes docs/reference/aps-api.md."""

from __future__ import annotations

import inspect
import json
import re
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from fastapi import FastAPI
from fastapi.routing import APIWebSocketRoute

from aps.api.backend import DaemonBackend
from aps.api.routes import build
from aps.daemon import Daemon, DaemonConfig

FILE: Final = Path("docs/reference/aps-api.md")
HEAD: Final = """\
# HTTP API

Made from the OpenAPI document of the code by `make api-docs`; what the API is for, and how it is guarded, is in
[aps.md](aps.md#http-api). Of a running UA, `/openapi.json` is the same for programs, and `/` a page that lists and
tries it. Refused before any route are: a wrong token (401), a foreign Origin (403) or Host (421), and a body of more
than 4 MiB (413).
"""
GROUPS: Final = {
    "look": "Look",
    "links": "Links",
    "commands": "Commands",
    "files": "Files",
    "stream": "Stream",
}
_ARGUMENT: Final = re.compile(r"    (\w+): (.*)")
_EVERY_COMMAND: Final = """\
A command takes its arguments as a JSON object. It answers when it has ended, with
`{"verb", "outcome", "reason", "value"}`; with `?wait=false` at once, with its number (`id`), by which
GET /commands/NUMBER and the stream have its progress and result."""


def reference(app: FastAPI) -> str:
    """The reference of an application, in Markdown."""
    api = app.openapi()
    operations = [
        (what["tags"][0], path, method, what)
        for path, methods in api["paths"].items()
        for method, what in methods.items()
    ]
    lines = [HEAD]
    for tag, title in GROUPS.items():
        lines += [f"## {title}", ""]
        if tag == "commands":
            one = next(what for _, _, _, what in operations if _is_command(what))
            lines += [_EVERY_COMMAND, "", _statuses(one), ""]
        for _, path, method, what in (one for one in operations if one[0] == tag):
            lines += _operation(path, method, what, api["components"]["schemas"])
        if tag == "stream":
            for route in (one for one in app.routes if isinstance(one, APIWebSocketRoute)):
                lines += _socket(route)
    return "\n".join(lines).rstrip() + "\n"


def _operation(path: str, method: str, what: Mapping[str, Any], schemas: Mapping[str, Any]) -> Iterator[str]:
    text, meanings = _parts(what.get("description", ""))
    summary = _plain(what["summary"])
    yield from (f"### {method.upper()} {path}", "", summary if summary.endswith(".") else f"{summary}.", "")
    more = text.removeprefix(summary).strip()
    if more:
        yield from (more, "")
    rows = [*_in_path(what, meanings), *_in_body(what, meanings, schemas)]
    if rows:
        yield from ("| argument | type | default | |", "|---|---|---|---|", *rows, "")
    if not _is_command(what):
        yield from (_statuses(what), "")


def _is_command(what: Mapping[str, Any]) -> bool:
    return any(parameter["name"] == "wait" for parameter in what.get("parameters", ()))


def _statuses(what: Mapping[str, Any]) -> str:
    answers = [f"{code} {_said(answer)}" for code, answer in sorted(what["responses"].items())]
    return f"Status: {'; '.join(answers)}."


def _parts(description: str) -> tuple[str, dict[str, str]]:
    """A docstring's text, and what it says of each argument."""
    text, _, arguments = description.partition("Args:\n")
    meanings: dict[str, str] = {}
    name = ""
    for line in arguments.splitlines():
        if match := _ARGUMENT.fullmatch(line):
            name, meanings[match[1]] = match[1], match[2]
        elif name and line.startswith("        "):
            meanings[name] += f" {line.strip()}"
        else:
            name = ""
    return _plain(text.strip()), {key: _plain(value) for key, value in meanings.items()}


def _plain(text: str) -> str:
    return re.sub(r"``(.+?)``", r"`\1`", " ".join(text.split())).replace("|", "\\|")


def _in_path(what: Mapping[str, Any], meanings: Mapping[str, str]) -> Iterator[str]:
    for parameter in what.get("parameters", ()):
        if parameter["in"] == "path":
            name = parameter["name"]
            yield f"| `{name}` (in the path) | {_type(parameter['schema'])} | | {meanings.get(name, '')} |"


def _in_body(
    what: Mapping[str, Any], meanings: Mapping[str, str], schemas: Mapping[str, Any]
) -> Iterator[str]:
    content = what.get("requestBody", {}).get("content", {})
    if "text/plain" in content:
        yield "| (body) | text | | the file |"
    schema = content.get("application/json", {}).get("schema", {})
    model = schemas[schema["$ref"].rsplit("/", 1)[1]] if "$ref" in schema else schema
    needed = model.get("required", ())
    for name, field in model.get("properties", {}).items():
        default = "needed" if name in needed else f"`{_json(field.get('default'))}`"
        meaning = meanings.get(name) or _plain(field.get("description", ""))
        yield f"| `{name}` | {_type(field)} | {default} | {meaning} |"


def _json(value: Any) -> str:
    return json.dumps(value)


def _type(schema: Mapping[str, Any]) -> str:
    if "anyOf" in schema:
        return " or ".join(_type(one) for one in schema["anyOf"])
    kind = schema.get("type", "any")
    inner = schema.get("items") if kind == "array" else schema.get("additionalProperties")
    if isinstance(inner, Mapping) and inner:
        return f"{kind} of {_type(inner)}"
    return str(kind)


def _said(answer: Mapping[str, Any]) -> str:
    told: str = answer["description"]
    told = {"Successful Response": "done", "Validation Error": "wrong arguments"}.get(told, told)
    return told[0].lower() + told[1:]


def _socket(route: APIWebSocketRoute) -> Iterator[str]:
    text, meanings = _parts(inspect.getdoc(route.endpoint) or "")
    yield from (f"### WebSocket {route.path}", "", text, "", "| in the query | default | |", "|---|---|---|")
    for parameter in inspect.signature(route.endpoint).parameters.values():
        if parameter.default is not inspect.Parameter.empty and parameter.name in meanings:
            yield f"| `{parameter.name}` | `{parameter.default!r}` | {meanings[parameter.name]} |"
    yield ""


def current() -> str:
    """The reference of the API as the code has it."""
    config = DaemonConfig(autopilot="tcp:127.0.0.1:5760", sysid=1)  # nothing is connected to
    app, *_ = build(DaemonBackend(Daemon(config)))
    return reference(app)


def main() -> int:
    """Write the file, in the working directory."""
    FILE.write_text(current(), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
