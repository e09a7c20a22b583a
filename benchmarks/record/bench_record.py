"""What the record of receptions costs: per row in the router, at the end of a run, and on disk.

A moving fleet, everyone heard by everyone, appended tick by tick; beside it the CSV that was written before, a row at
a time. Medians of CPU time.

    python -m benchmarks.record.bench_record [--nodes 50] [--rows 1000000] [--rounds 3] [--json]
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bridge.record.tables.deliveries import DELIVERIES, FATES, INSTANTS, DeliveryWriter
from bridge.record.tables.every import finish_tables
from bridge.record.tables.reader import read_batches
from bridge.record.tables.schema import Columns


def fleet_columns(nodes: int, ticks: int, seed: int = 1) -> Iterator[Columns]:
    """What a tick of a moving fleet leaves: fading and shadowing drawn anew, rounded as the channel rounds."""
    rng = np.random.Generator(np.random.PCG64(seed))
    tx, rx = (each.ravel() for each in np.meshgrid(range(nodes), range(nodes), indexing="ij"))
    tx, rx = tx[tx != rx], rx[tx != rx]
    position_m = rng.uniform(-1000.0, 1000.0, (nodes, 3))
    for tick in range(ticks):
        position_m += rng.normal(0.0, 1.0, (nodes, 3))
        distance_m = np.linalg.norm(position_m[tx] - position_m[rx], axis=1)
        fading_db = 10.0 * np.log10(rng.exponential(1.0, tx.size)) + rng.normal(0.0, 4.0, tx.size)
        power_dbm = in_steps(-20.0 - 25.0 * np.log10(distance_m) + fading_db, 1e3)
        snr_db = in_steps(power_dbm + 93.978, 1e3)
        per = in_steps(1.0 / (1.0 + np.exp(snr_db - 8.0)), 1e7)
        yield {
            "sim_time_ns": np.full(tx.size, tick * 50_000_000),
            "tx": tx,
            "rx": rx,
            "seq": np.full(tx.size, tick),
            "packets": np.ones(tx.size, dtype=np.int64),
            "length_bytes": np.full(tx.size, 324),
            "distance_m": in_steps(distance_m, 1e3),
            "received_power_dbm": power_dbm,
            "snr_db": snr_db,
            "per": per,
            "fate": (rng.random(tx.size) < per).astype(np.int64),
            "received_ns": np.full(tx.size, (tick + 1) * 50_000_000),
            **dict.fromkeys(INSTANTS, np.full(tx.size, tick * 50_000_000)),
            "attempts": np.ones(tx.size, dtype=np.int64),
        }


def in_steps(values: NDArray[np.float64], steps: float) -> NDArray[np.float64]:
    return np.asarray(np.rint(values * steps) / steps + 0.0)


def _append(run: Path, nodes: list[str], ticks: list[Columns]) -> None:
    writer = DeliveryWriter(run, nodes)
    for columns in ticks:
        writer.append(len(columns["tx"]), **columns)
    writer.close()


def _csv(run: Path, nodes: list[str], ticks: list[Columns]) -> None:
    with (run / "rows.csv").open("w") as file:
        for columns in ticks:
            for t, tx, rx, seq, _, length, distance, power, snr, per, fate, *_said in zip(
                *(values.tolist() for values in columns.values()), strict=True
            ):
                file.write(
                    f"{t},{nodes[tx]},{nodes[rx]},{seq},{length},{distance:.3f},{power:.3f},{snr:.3f},{per:.7g},"
                    f"{FATES[fate]}\n"
                )


def _read(run: Path) -> int:
    return sum(len(batch["per"]) for batch in read_batches(run, DELIVERIES))


def measure(nodes: int, rows: int, rounds: int) -> dict[str, float]:
    """ns per row of each step, and bytes per row of each file."""
    ticks = list(fleet_columns(nodes, max(1, rows // (nodes * (nodes - 1)))))
    count = sum(len(columns["tx"]) for columns in ticks)
    names = [str(node) for node in range(nodes)]
    taken: dict[str, list[float]] = {}
    sizes: dict[str, float] = {}
    for _ in range(rounds):
        with tempfile.TemporaryDirectory() as folder:
            run = Path(folder)
            steps: dict[str, Callable[[], object]] = {
                "append": lambda run=run: _append(run, names, ticks),
                "finish": lambda run=run: finish_tables(run),
                "read": lambda run=run: _read(run),
                "csv": lambda run=run: _csv(run, names, ticks),
            }
            for name, step in steps.items():
                began_s = time.process_time()
                step()
                taken.setdefault(f"{name}_ns", []).append((time.process_time() - began_s) / count * 1e9)
                if name == "append":
                    sizes["journal_bytes"] = DELIVERIES.journal_path(run).stat().st_size / count
            sizes["parquet_bytes"] = DELIVERIES.parquet_path(run).stat().st_size / count
            sizes["csv_bytes"] = (run / "rows.csv").stat().st_size / count
    medians = {name: statistics.median(values) for name, values in taken.items()}
    return {"rows": count, **medians, **sizes}


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--nodes", type=int, default=50)
    parser.add_argument("--rows", type=int, default=1_000_000)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args(arguments)
    figures = measure(options.nodes, options.rows, options.rounds)
    if options.json:
        print(json.dumps(figures))
        return 0
    for name, value in figures.items():
        print(f"{name:<14} {value:10.1f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
