"""How long it takes to decide a run's transmissions anew, and to play its record: python -m benchmarks replay.

Without --run it flies the scenario `separation` first (150 s of sim time, two UA).
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any

from lostlink import fly
from lostlink.redecision.redecide import redecide
from lostlink.replay.player import Player

RADIOS = ("moon2020", "wifi-2.4", "lte-like")


def measure(run: Path, rounds: int) -> dict[str, Any]:
    """The best of some rounds, s."""
    result = redecide(run)
    player = Player.open(run)
    seconds = {
        f"redecide, {radio}": _best(rounds, lambda radio=radio: redecide(run, radio=radio))
        for radio in RADIOS
    }
    seconds["redecide, as recorded"] = _best(rounds, lambda: redecide(run).comparison)
    seconds["open"] = _best(rounds, lambda: Player.open(run))
    seconds["read states"] = _best(1, lambda: player.record.states)
    middle_ns = (player.begin_ns + player.end_ns) // 2
    seconds["seek to the middle, states"] = _best(rounds, lambda: player.seek(middle_ns).states())
    seconds["play, nothing looked at"] = _best(rounds, lambda: _play(run, everything=False))
    seconds["play, everything looked at"] = _best(rounds, lambda: _play(run, everything=True))
    return {
        "run": str(run),
        "nodes": len(player.record.nodes),
        "sim_s": (player.end_ns - player.begin_ns) / 1e9,
        "fates": result.comparison.fates,
        "is_same": result.comparison.is_same,
        "seconds": seconds,
    }


def _best(rounds: int, work: Callable[[], object]) -> float:
    found = []
    for _ in range(rounds):
        begin = perf_counter()
        work()
        found.append(perf_counter() - begin)
    return min(found)


def _play(run: Path, *, everything: bool) -> None:
    for moment in Player.open(run).moments():
        if everything:
            moment.truths(), moment.fates(), moment.links(), moment.communication()
            moment.statuses(), moment.received(), moment.states()


def main(arguments: Sequence[str]) -> dict[str, Any]:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--run", type=Path, help="directory of a run")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args(arguments)
    with TemporaryDirectory() as folder:
        run = options.run or fly("separation", changes={"ports.zenoh": 0}, directory=folder).path
        found = measure(run, options.rounds)
    if options.json:
        print(json.dumps(found))
        return found
    print(f"{found['nodes']} nodes, {found['sim_s']:.1f} s of sim time, {found['fates']} fates")
    for name, seconds in found["seconds"].items():
        print(f"  {name:<28} {1e3 * seconds:8.1f} ms")
    return found


if __name__ == "__main__":
    import sys

    main(sys.argv[1:])
