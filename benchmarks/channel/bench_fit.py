"""What `lostlink fit` costs, by the number of packets: `python -m benchmarks fit`.

Generated logs (`benchmarks/channel/fit_coverage.py`): without received powers as a run's deliveries are, with them, and
with shadowing that is correlated along the track. Packets of about one distance are put together, so that a log of a
hundred times the packets takes some ten times as long; with readings hundreds of times, as fewer of them say the same.
CPU time of the process.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence

from benchmarks.channel.fit_coverage import one_correlated_fit, one_fit

KINDS = {
    "no RSSI": one_fit,
    "no RSSI, sigma known": one_fit,
    "open, no base loss": one_fit,
    "25 m, steps of 1 dB": one_correlated_fit,
}
PACKETS = (2_000, 20_000, 200_000)


def measure(name: str, packets: int) -> dict[str, float | int | str]:
    """CPU time of one fit."""
    fit, cpu_s = KINDS[name](name, 0, packets)
    return {"log": name, "packets": packets, "cpu_s": round(cpu_s, 3), "log_likelihood": fit.log_likelihood}


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--packets", type=int, nargs="+", default=list(PACKETS))
    parser.add_argument("--only", default="", choices=["", *KINDS], help="one kind of log")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args(arguments)
    for name in (each for each in KINDS if options.only in ("", each)):
        for packets in options.packets:
            row = measure(name, packets)
            print(json.dumps(row) if options.json else f"{name:<22}{packets:>9} packets {row['cpu_s']:>9} s")


if __name__ == "__main__":
    main()
