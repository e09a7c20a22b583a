"""`lostlink aps`: the MAVLink daemon alone, with a real vehicle for one; the options are those of `aps` itself."""

from __future__ import annotations

import sys

import click


@click.command(
    short_help="Serve one autopilot to any number of MAVLink clients.",
    context_settings={"ignore_unknown_options": True, "help_option_names": []},
)
@click.argument("arguments", nargs=-1, type=click.UNPROCESSED)
def aps(arguments: tuple[str, ...]) -> None:
    """Connect to an autopilot and serve it to any number of MAVLink clients.

    \b
    Examples:
      lostlink aps --help
      lostlink aps --autopilot serial:/dev/ttyACM0:115200 --udp-out 127.0.0.1:14550 --tlog logs
    """
    from aps.__main__ import main  # pymavlink takes its time, and the other commands do without

    sys.exit(main(list(arguments), "lostlink aps"))
