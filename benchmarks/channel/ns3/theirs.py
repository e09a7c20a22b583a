"""A setting by ns-3: `dcf.cc`, built where ns-3 and its headers are (Debian's libns3-dev)."""

from __future__ import annotations

import csv
import shutil
import subprocess
from math import inf
from pathlib import Path

from benchmarks.channel.ns3.settings import Count, Counts, Setting

SOURCE = Path(__file__).parent / "dcf.cc"
HEADER = Path("/usr/include/ns3/wifi-module.h")
LIBRARIES = ("wifi", "propagation", "mobility", "network", "core")


def missing() -> str | None:
    """What is not there to build it with; None: all is."""
    if shutil.which("g++") is None:
        return "no g++"
    return None if HEADER.exists() else "no ns-3 (Debian: apt install libns3-dev)"


def build(folder: Path) -> Path:
    """Return the program, built into a folder.

    Raises:
        subprocess.CalledProcessError: this ns-3 is another, it does not compile.
    """
    program = folder / "dcf"
    libraries = [f"-lns3-{name}" for name in LIBRARIES]
    subprocess.run(["g++", "-std=c++17", "-O2", str(SOURCE), "-o", str(program), *libraries], check=True)
    return program


def arguments(setting: Setting, seeds: int) -> list[str]:
    """The command line of a setting."""
    mode = f"DsssRate{setting.rate_mbps:g}Mbps" if setting.is_b else f"OfdmRate{setting.rate_mbps:g}Mbps"
    given = {
        "standard": "b" if setting.is_b else "a",
        "mode": mode,
        "control-mode": "DsssRate1Mbps" if setting.is_b else "OfdmRate6Mbps",
        "at": ";".join(f"{x:.6g},{y:.6g}" for x, y in setting.places_m),
        "senders": ",".join(map(str, setting.senders)),
        "to": -1 if setting.to is None else setting.to,
        "observer": setting.observer,
        "mover": setting.observer if setting.speed_mps else -1,
        "speed": setting.speed_mps,
        "bytes": setting.length_bytes,
        "rate": setting.a_second,
        "seconds": setting.seconds,
        "parts": setting.parts,
        "seeds": seeds,
        "rss-dbm": setting.received_dbm or 0.0,
        "exponent": setting.exponent,
        "tx-dbm": setting.transmit_dbm,
        "preamble-dbm": setting.preamble_dbm,
        "energy-dbm": setting.energy_dbm,
        "capture-db": setting.capture_db if setting.capture_db < inf else 0.0,
        "capture-window-us": setting.capture_window_us,
        "rts-from": 0 if setting.rts else 65535,
        "whole-headers": int(setting.whole_headers),
    }
    return [f"--{name}={value}" for name, value in given.items()]


def run(program: Path, setting: Setting, seeds: int) -> list[Counts]:
    """Several seeds of a setting."""
    command = [str(program), *arguments(setting, seeds)]
    printed = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    found: list[dict[tuple[int, int], Count]] = [{} for _ in range(seeds)]
    for row in csv.DictReader(printed.splitlines()):
        count = Count(
            int(row["offered"]), int(row["transmitted"]), int(row["delivered"]), float(row["delay_sum_s"])
        )
        found[int(row["seed"]) - 1][int(row["sender"]), int(row["part"])] = count
    return list(found)
