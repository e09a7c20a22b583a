"""Samples of a run for people and other programs: decoded where they are messages of ours."""

from __future__ import annotations

import dataclasses
import json
import math
from contextlib import suppress
from typing import Any

from bridge.bus.messages import DecodeError, decode
from bridge.bus.messages.codec import class_of
from bridge.bus.reception import signal_of
from bridge.bus.session import JSON, Sample, Stamp


def describe(sample: Sample) -> dict[str, Any]:
    """A sample in plain types: key, stamp if it has one, length, and the message or the start of its bytes."""
    payload = sample.payload.to_bytes()
    content: dict[str, Any] = {"key": str(sample.key_expr)}
    stamp = Stamp.from_sample(sample)
    if stamp is not None:
        content |= {"seq": stamp.seq, "sim_time_s": stamp.sim_time_ns / 1e9}
        rssi_dbm, snr_db, _ = signal_of(sample)
        if "/rx/" in content["key"] and not math.isnan(rssi_dbm):
            content |= {"rssi_dbm": round(rssi_dbm, 3), "snr_db": round(snr_db, 3)}
    content["length_bytes"] = len(payload)
    cls = class_of(str(sample.encoding))
    if str(sample.encoding) == JSON:
        with suppress(ValueError, RecursionError):  # of anybody: it may be none
            return content | {"type": JSON, "message": _plain(json.loads(payload))}
    if cls is None:
        return content | {"encoding": str(sample.encoding), "bytes": payload[:64].hex()}
    try:
        message: Any = decode(payload, cls)
    except DecodeError as error:
        return content | {"error": str(error), "bytes": payload[:64].hex()}
    return content | {"type": cls.TYPE, "message": _plain(dataclasses.asdict(message))}


def _plain(value: Any) -> Any:
    """JSON has no NaN, no infinity and no bytes: they become null, text and hexadecimal text."""
    if isinstance(value, bytes):
        return value.hex()
    if isinstance(value, dict):
        return {k: _plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None if math.isnan(value) else str(value)
    return value


def as_text(content: dict[str, Any]) -> str:
    """What `describe` gave, for people."""
    head = [content["key"]]
    if "seq" in content:
        head.append(f"#{content['seq']} at {content['sim_time_s']:.3f} s")
    if "rssi_dbm" in content:
        head.append(f"{content['rssi_dbm']:.1f} dBm")
    head.append(f"{content['length_bytes']} B")
    if "message" not in content:
        return "  ".join([*head, content.get("error", content.get("encoding", "")), content["bytes"]])
    body = content["message"]
    nothing = "null" if content["type"] == JSON else "nan"
    lines = _lines(body, nothing) if isinstance(body, dict) else [json.dumps(body)]
    return "  ".join([*head, content["type"].rsplit("/", 1)[1]]) + "".join(f"\n  {line}" for line in lines)


def _lines(body: dict[str, Any], nothing: str, prefix: str = "") -> list[str]:
    lines: list[str] = []
    for name, value in body.items():
        if isinstance(value, dict):
            lines += _lines(value, nothing, f"{prefix}{name}.")
        else:
            text = value if isinstance(value, str) else _text(value, nothing)
            lines.append(f"{prefix}{name}: {text}")
    return lines


def _text(value: Any, nothing: str) -> str:
    """A value within a message; ``nothing``: what None stands for."""
    if value is None:
        return nothing
    if isinstance(value, list):
        return f"[{', '.join(_text(each, nothing) for each in value)}]"
    if isinstance(value, dict):
        return f"{{{', '.join(f'{name!r}: {_text(each, nothing)}' for name, each in value.items())}}}"
    return repr(value)
