"""The command `lostlink`."""

from __future__ import annotations

import sys
from importlib import metadata

import click

from bridge.cli.compare import compare
from bridge.cli.doctor import doctor
from bridge.cli.echo import echo
from bridge.cli.fit import fit
from bridge.cli.refly import refly
from bridge.cli.run import run
from bridge.cli.token import token
from channel.cli.commands import main as channel_commands


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110})
@click.version_option(metadata.version("lostlink"), prog_name="lostlink")
def lostlink() -> None:
    """Fly real ArduPilot stacks on JSBSim airframes; drop packets between them as a channel model predicts.

    \b
    Examples:
      lostlink run                                 two copters, one radio: where does the link break?
      lostlink run my.yaml --speed 1               your scenario, in real time
      lostlink link --radio moon2020 --distance 400
      lostlink echo 'lostlink/**/node/*/rx/**'       what the radio delivers, during a run
      lostlink doctor                              what is installed, found and free
    """


for command in (run, refly, compare, doctor, echo, token, *channel_commands.commands.values(), fit):
    lostlink.add_command(command)


def main() -> None:
    """Entry point: errors of use end with status 2, a broken pipe quietly."""
    try:
        lostlink(prog_name="lostlink")
    except BrokenPipeError:
        sys.stderr.close()
        sys.exit(141)


if __name__ == "__main__":
    main()
