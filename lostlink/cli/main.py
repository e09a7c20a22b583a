"""The command `lostlink`."""

from __future__ import annotations

import errno
import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module, metadata
from typing import Any

import click

from lostlink.flight.exits import OUTPUT_CLOSED
from lostlink.flight.shown.say import say

COMMANDS = {
    "run": "lostlink.cli.flying.run",
    "schema": "lostlink.cli.flying.schema",
    "refly": "lostlink.cli.flying.refly",
    "check": "lostlink.cli.flying.check",
    "compare": "lostlink.cli.records.compare",
    "judge": "lostlink.cli.records.judge",
    "redecide": "lostlink.cli.records.redecide",
    "replay": "lostlink.cli.records.replay",
    "report": "lostlink.cli.records.report",
    "export": "lostlink.cli.records.export",
    "aps": "lostlink.cli.live.aps",
    "attach": "lostlink.cli.live.attach",
    "doctor": "lostlink.cli.live.doctor",
    "echo": "lostlink.cli.live.echo",
    "modem": "lostlink.cli.live.modem",
    "token": "lostlink.cli.live.token",
    "study": "lostlink.cli.flying.study",
    "view": "lostlink.cli.live.view",
    "air": "channel.cli.air_command",
    "link": "channel.cli.commands",
    "radios": "channel.cli.commands",
    "figures": "channel.cli.commands",
    "laws": "channel.cli.commands",
    "fit": "lostlink.cli.records.fit",
}
"""The module of each command, which has its name there too. Only that of the command given is imported."""
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""A disk, a quota, or the limit of a file's size (`ulimit -f`)."""


@contextmanager
def _read_or_ended() -> Iterator[None]:
    """End with a status of its own if nobody reads what is printed: 1, as of click, would be that of a failure."""
    try:
        yield
    except BrokenPipeError:
        _say_no_more()
        sys.exit(OUTPUT_CLOSED)


def _say_no_more() -> None:
    """What is still to be written at the end comes to nothing."""
    for number in (1, 2):
        os.dup2(os.open(os.devnull, os.O_WRONLY), number)


class LazyCommands(click.Group):
    """A group whose commands are imported when they are asked for."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002
        """The names, as in the help."""
        return sorted(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002
        """The command of a name; None if there is none."""
        if cmd_name not in COMMANDS:
            return None
        command = getattr(import_module(COMMANDS[cmd_name]), cmd_name)
        return command if isinstance(command, click.Command) else None

    def make_context(self, *arguments: Any, **options: Any) -> click.Context:
        """As click does it, but for the status if nobody reads the help."""
        with _read_or_ended():
            return super().make_context(*arguments, **options)

    def invoke(self, ctx: click.Context) -> object:
        """As click does it, but for the status if nobody reads what is printed."""
        with _read_or_ended():
            return super().invoke(ctx)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """As click does it; what is no command is told with the nearest one.

        Raises:
            click.UsageError: there is no such command.
        """
        name = args[0]
        if name in COMMANDS or name.startswith("-"):
            return super().resolve_command(ctx, args)
        from sitl_configs.near import near_miss

        raise click.UsageError(
            f"there is no command {name!r}{near_miss(name, COMMANDS)} (lostlink --help lists them)", ctx
        )


@click.group(
    cls=LazyCommands, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110}
)
@click.version_option(metadata.version("lostlink"), prog_name="lostlink")
def lostlink() -> None:
    """Fly real ArduPilot and PX4 stacks on JSBSim airframes; drop packets between them as a channel model predicts.

    \b
    Examples:
      lostlink run                                 two copters, one radio: where does the link break?
      lostlink run my.yaml --speed 1               your scenario, in real time
      lostlink link --radio wifi-2.4 --ground-distance 400
      lostlink echo 'lostlink/**/node/*/rx/**'       what the radio delivers, during a run
      lostlink doctor                              what is installed, found and free
    """


def main() -> None:
    """Entry point: errors of use end with status 2, a broken pipe quietly."""
    with _read_or_ended():
        _command()


def _command() -> None:
    try:
        sys.exit(lostlink(prog_name="lostlink", standalone_mode=False))
    except click.UsageError as error:
        usage = "" if error.ctx is None else f"\n{error.ctx.get_usage()}"
        say(f"lostlink: {error.format_message()}{usage}", err=True)
        sys.exit(error.exit_code)
    except click.ClickException as error:
        say(f"lostlink: {error.format_message()}", err=True)
        sys.exit(error.exit_code)
    except OSError as error:
        if error.errno not in FULL:
            raise
        where = "" if error.filename else ": where its output goes to, or the run is"
        say(f"lostlink: {error}{where}", err=True)
        if sys.stdout is sys.__stdout__:
            _say_no_more()
        sys.exit(1)
    except click.Abort:  # Ctrl-C, where nothing else has a word for it
        say("lostlink: interrupted", err=True)
        sys.exit(128 + signal.SIGINT)


if __name__ == "__main__":
    main()
