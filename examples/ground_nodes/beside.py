"""Transmit as a node, from a program beside a run: a line from standard input is a packet for UA 0.

lostlink run examples/ground_nodes/beside.yaml                     in one terminal
python examples/ground_nodes/beside.py runs/<time>-beside          in another; Ctrl-D ends it
"""

from __future__ import annotations

import asyncio
import sys

from lostlink import connect_ua


async def main(run: str) -> None:
    async with connect_ua(run, node="probe", is_sender=True) as probe:
        heard: set[str] = set()
        probe.on_packet(lambda sender, *_: heard.add(sender))
        while line := await asyncio.to_thread(sys.stdin.readline):
            number = probe.transmit("chatter", line.strip().encode(), to="0")
            print(f"packet {number} is on the air; heard {', '.join(sorted(heard)) or 'nobody'}", flush=True)


asyncio.run(main(sys.argv[1]))
