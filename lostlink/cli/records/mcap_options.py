"""Options of commands that write `run.mcap`, over what the scenario says of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import click
from pydantic import ValidationError

from bridge.scenario.document.written import WrittenPlace, written_at
from bridge.scenario.mcap import TOPICS, McapSettings
from bridge.scenario.mistakes.explain import explained

KINDS = ", ".join(TOPICS)


def mcap_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options that `changed` takes."""
    for option in reversed(
        (
            click.option(
                "--payloads", is_flag=True, default=None, help="With --mcap: packets with their payloads."
            ),
            click.option(
                "--mavlink",
                type=click.Choice(["frames", "messages", "none"]),
                help="With --mcap: MAVLink as bytes, decoded with a topic per message, or not.",
            ),
            click.option(
                "--compression",
                type=click.Choice(["zstd", "lz4", "none"]),
                help="With --mcap: of its chunks.",
            ),
            click.option(
                "--rate",
                "rates",
                multiple=True,
                metavar="KIND=HZ",
                help=f"With --mcap: messages per second of each topic of a kind; 0 leaves it out. Kinds: {KINDS}.",
            ),
            click.option(
                "--size",
                "sizes",
                multiple=True,
                metavar="KIND=BYTES",
                help="With --mcap: leave out longer messages of a kind.",
            ),
        )
    ):
        command = option(command)
    return command


def changed(
    settings: McapSettings,
    *,
    payloads: bool | None,
    mavlink: str | None,
    compression: str | None,
    rates: Sequence[str],
    sizes: Sequence[str],
) -> McapSettings:
    """The settings with what was asked for.

    Raises:
        click.UsageError: a rate or a size is none, or there is no such kind of topic.
    """
    content = settings.model_dump()
    for name, value in (("payloads", payloads), ("mavlink", mavlink), ("compression", compression)):
        if value is not None:
            content[name] = value
    content["rates_hz"] |= dict(_pair("--rate", text, float) for text in rates)
    content["sizes_bytes"] |= dict(_pair("--size", text, int) for text in sizes)
    try:
        return McapSettings.model_validate(content)
    except ValidationError as error:
        root = written_at(content, WrittenPlace("options", None, Path()))
        raise click.UsageError("; ".join(explained(root, error, McapSettings))) from None


def _pair(option: str, text: str, number: type[float] | type[int]) -> tuple[str, float]:
    kind, _, value = text.partition("=")
    if kind not in TOPICS:
        raise click.UsageError(f"{option} {text}: no kind of topic {kind!r}; there are {KINDS}")
    try:
        return kind, number(value)
    except ValueError:
        raise click.UsageError(f"{option} {text}: {value!r} is no number") from None
