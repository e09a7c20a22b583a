"""`lostlink echo`: print what goes over Zenoh, decoded."""

from __future__ import annotations

import dataclasses
import json
import math
import queue
import signal
import sys
from pathlib import Path
from typing import Any

import click
import zenoh

from bridge.bus.identity.keyring import OBSERVERS
from bridge.bus.keys import ROOT
from bridge.bus.messages import DecodeError, decode
from bridge.bus.messages.codec import class_of
from bridge.bus.reception import signal_of
from bridge.bus.session import Sample, SessionError, Stamp, checked_endpoint, open_client, plain_text
from bridge.run.directory import live_runs

WAITING_MAX = 10_000
"""Samples that may wait for a slow reader of our output; later ones are dropped, and said to be."""


@click.command(short_help="Print decoded samples of a running simulation.")
@click.argument("key")
@click.option("--connect", metavar="ENDPOINT", help="Zenoh router, such as tcp/127.0.0.1:7447.")
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("runs"),
    help="Where runs are kept: joins the newest that is running, unless --connect is given.",
)
@click.option("--count", type=click.IntRange(min=1), help="End after so many samples.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object per line.")
def echo(key: str, connect: str | None, out: Path, count: int | None, as_json: bool) -> None:
    """Print the samples that match KEY (a Zenoh key expression), decoded where they are messages of ours.

    It looks as an observer, who sees everything but what nodes give to their radios (tx), commands, and what the
    radio tells the hosts.

    \b
    Examples:
      lostlink echo 'lostlink/**/node/*/rx/**'
      lostlink echo 'lostlink/*/clock' --count 1
      lostlink echo 'lostlink/*/tick/links' --json
    """
    samples: queue.SimpleQueue[Sample | None] = queue.SimpleQueue()
    dropped: list[None] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: samples.put(None))

    def on_sample(sample: Sample) -> None:
        if samples.qsize() < WAITING_MAX:
            samples.put(sample)
        else:
            dropped.append(None)

    try:
        endpoint = checked_endpoint(connect) if connect else _newest_endpoint(out)
    except ValueError as error:
        raise click.BadParameter(str(error), param_hint="--connect") from error
    try:
        with open_client(endpoint, OBSERVERS) as session:
            try:
                session.subscribe(key, on_sample)
            except zenoh.ZError as error:
                raise click.BadParameter(
                    f"{key!r} is not a Zenoh key expression: {plain_text(error)}", param_hint="KEY"
                ) from error

            def on_router(_key: str, is_alive: bool) -> None:
                if not is_alive:
                    samples.put(None)

            session.watch_alive(f"{ROOT}/*/alive/router", on_router)
            _print_samples(samples, count, as_json=as_json)
        if dropped:
            click.echo(f"lostlink: {len(dropped)} samples came faster than they were read", err=True)
    except SessionError as error:
        click.echo(f"lostlink: {error}", err=True)
        sys.exit(1)


def _newest_endpoint(out: Path) -> str:
    runs = live_runs(out)
    if not runs:
        click.echo(
            f"lostlink: no run goes on in {out}/; start one with `lostlink run`, or give --connect", err=True
        )
        sys.exit(1)
    return runs[0].endpoint


def _print_samples(samples: queue.SimpleQueue[Sample | None], count: int | None, *, as_json: bool) -> None:
    printed = 0
    while (sample := samples.get()) is not None:
        content = describe(sample)
        click.echo(json.dumps(content) if as_json else _as_text(content))
        printed += 1
        if printed == count:
            return


def describe(sample: Sample) -> dict[str, Any]:
    """A sample in plain types: key, stamp if it has one, length, and the message or the start of its bytes."""
    payload = sample.payload.to_bytes()
    content: dict[str, Any] = {"key": str(sample.key_expr)}
    stamp = Stamp.from_sample(sample)
    if stamp is not None:
        content |= {"seq": stamp.seq, "sim_time_s": stamp.sim_time_ns / 1e9}
        rssi_dbm, snr_db = signal_of(sample)
        if not math.isnan(rssi_dbm):
            content |= {"rssi_dbm": round(rssi_dbm, 3), "snr_db": round(snr_db, 3)}
    content["length_bytes"] = len(payload)
    cls = class_of(str(sample.encoding))
    if cls is None:
        return content | {"encoding": str(sample.encoding), "bytes": payload[:64].hex()}
    try:
        message: Any = decode(payload, cls)
    except DecodeError as error:
        return content | {"error": str(error), "bytes": payload[:64].hex()}
    return content | {"type": cls.TYPE, "message": _plain(dataclasses.asdict(message))}


def _plain(value: Any) -> Any:
    """JSON has no NaN and no infinity: they become null and text."""
    if isinstance(value, dict):
        return {k: _plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None if math.isnan(value) else str(value)
    return value


def _as_text(content: dict[str, Any]) -> str:
    head = [content["key"]]
    if "seq" in content:
        head.append(f"#{content['seq']} at {content['sim_time_s']:.3f} s")
    if "rssi_dbm" in content:
        head.append(f"{content['rssi_dbm']:.1f} dBm")
    head.append(f"{content['length_bytes']} B")
    body = content.get("message")
    if body is None:
        return "  ".join([*head, content.get("error", content.get("encoding", "")), content["bytes"]])
    return "  ".join([*head, content["type"].rsplit("/", 1)[1]]) + "".join(
        f"\n  {line}" for line in _lines(body)
    )


def _lines(body: dict[str, Any], prefix: str = "") -> list[str]:
    lines: list[str] = []
    for name, value in body.items():
        if isinstance(value, dict):
            lines += _lines(value, f"{prefix}{name}.")
        else:
            lines.append(f"{prefix}{name}: {value}")
    return lines
