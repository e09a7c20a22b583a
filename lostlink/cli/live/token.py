"""`lostlink token`: what a program of one's own needs to join a run."""

from __future__ import annotations

import json
import shlex
from pathlib import Path

import click

from bridge.bus.identity.roster import OBSERVER, OPERATOR, node_identity
from bridge.bus.keys import Keys
from bridge.run.access import Access, NoAccess, access_of
from lostlink.cli.exits import fail
from lostlink.cli.run_path import RunPath


@click.command(short_help="Print what a program of yours needs to join a running simulation.")
@click.argument("run", type=RunPath())
@click.option("--node", metavar="ID", help="Act for this node: its packets, state and commands.")
@click.option("--operator", is_flag=True, help="Command all aircraft, and look at everything.")
@click.option("--observer", is_flag=True, help="Look only: the password is the same in every run.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object instead of shell variables.")
def token(run: Path, node: str | None, operator: bool, observer: bool, as_json: bool) -> None:
    """Print endpoint, user and password for RUN (its directory, or its name in runs/), which must still go on.

    The password is valid for this run only. It gives the rights in docs/reference/identities.md: keep it to yourself.

    \b
    Examples:
      eval "$(lostlink token runs/20261121T120000Z-separation --node 1)"
      lostlink token runs/20261121T120000Z-separation --operator --json | jq -r .password
    """
    if (node is not None) + operator + observer != 1:
        raise click.UsageError("say as whom: --node ID, --operator or --observer")
    identity = node_identity(node) if node is not None else OPERATOR if operator else OBSERVER
    try:
        content = as_plain(access_of(run, identity))
    except NoAccess as error:
        fail(error, 1)
    if as_json:
        click.echo(json.dumps(content))
    else:
        for name, value in content.items():
            click.echo(f"export LOSTLINK_{name.upper()}={shlex.quote(value)}")


def as_plain(access: Access) -> dict[str, str]:
    """As `--json` prints it; ``prefix`` begins all keys of the run."""
    return {
        "run": access.run,
        "prefix": Keys(access.run).prefix,
        "endpoint": access.endpoint,
        "user": access.credentials.user,
        "password": access.credentials.password,
    }
