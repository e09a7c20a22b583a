"""`lostlink attach`: a program whose only network is the radio of a node of a running simulation."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from lostlink.cli.exits import fail, tell
from lostlink.cli.run_path import RunPath

CANNOT_ATTACH = 125
"""As of env, nohup and docker: it is not the program that failed."""


@click.command(short_help="Run a program whose only network is a node's radio.")
@click.argument("run", type=RunPath())
@click.option("--node", required=True, metavar="ID", help="The node whose radio it is.")
@click.option(
    "--radio", default="main", show_default=True, metavar="NAME", help="Which of the node's radios."
)
@click.option("--subnet", default="10.42.0.0/24", show_default=True, help="Of the nodes' addresses.")
@click.option(
    "--mtu", type=int, metavar="BYTES", help="Of the interface. [what the radio takes, at most 1500]"
)
@click.option("--quiet", is_flag=True, help="Say nothing but what is wrong.")
@click.argument("command", nargs=-1, required=True, type=click.UNPROCESSED)
def attach(
    run: Path, node: str, radio: str, subnet: str, mtu: int | None, quiet: bool, command: tuple[str, ...]
) -> None:
    """Run COMMAND in a network namespace whose only way out is a radio of node ID in the simulation RUN.

    RUN is a directory, or its name in runs/; it must still go on, at speed 1. The program is any, unchanged: it sees
    an interface radio0 with IPv4. UA I has address 10.42.0.(I + 1) and the name ua-I; ground nodes count down from
    10.42.0.254 and are called by their ids. A packet to an address is a unicast to that node, broadcast and multicast
    go to all. Packets enter the radio at the next tick of the run, and are recorded as inputs: lostlink refly repeats
    the run without the program.

    Root is not needed where users may make namespaces. Ends with the program's exit code; with 125 if it could not be
    attached.

    \b
    Examples:
      lostlink attach runs/A --node 0 -- ping -c 5 ua-1
      lostlink attach runs/A --node 1 -- iperf3 --server --one-off
      lostlink attach runs/A --node 0 -- iperf3 --client ua-1 --udp --bitrate 1M
      lostlink attach runs/A --node gcs --radio telemetry -- python my_program.py
      lostlink attach runs/A --node 2 -- bash
    """
    if sys.platform != "linux":
        fail("network namespaces are Linux's: attach needs Linux", CANNOT_ATTACH)
    from bridge.bus.session import SessionError
    from lostlink.attach.claim import AlreadyAttached, claimed
    from lostlink.attach.plan import AttachRequest, plan_of
    from lostlink.attach.program import NoProgram
    from lostlink.attach.serve import attach as attached

    say = (lambda _: None) if quiet else tell
    try:
        plan = plan_of(AttachRequest(run, node, radio, subnet, mtu))
        with claimed(plan.directory.path, plan.title, node, command, str(plan.subnet)) as elsewhere:
            if elsewhere:
                tell(
                    f"warning: a program on {plan.subnet} reaches none on another --subnet: node {elsewhere}"
                )
            status, counts = attached(plan, command, say, warn=tell)
    except (ValueError, OSError, SessionError, AlreadyAttached, NoProgram) as error:
        fail(error, CANNOT_ATTACH)
    say(counts.summary())
    sys.exit(status)
