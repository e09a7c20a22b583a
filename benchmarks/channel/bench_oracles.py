"""How far laws are from the values that ns-3 3.37 computed (tests/data): `python -m benchmarks oracles`."""

from __future__ import annotations

import csv
import warnings
from collections.abc import Mapping
from pathlib import Path as FilePath

import numpy as np
from numpy.typing import NDArray

from channel.geometry import Path
from channel.phy.error_model import Band
from channel.phy.ofdm import OfdmNist, OfdmYans
from channel.propagation.hata import Cost231Hata, OkumuraHata
from channel.propagation.path_loss import FreeSpace, LogDistance, PathLossModel
from channel.propagation.two_ray import TwoSlope
from channel.validity import ValidityWarning

DATA = FilePath(__file__).parents[2] / "tests" / "data"
PLAIN: Mapping[str, PathLossModel] = {
    "friis": FreeSpace(),
    "two-ray": TwoSlope(),
    "log-distance-n3-l0-46.6777": LogDistance(exponent=3.0, reference_loss_db=46.6777),
}
HATA = {"okumura-hata": OkumuraHata, "cost231-hata": Cost231Hata}
OFDM = {"nist": OfdmNist, "yans": OfdmYans}
Differences = dict[str, NDArray[np.float64]]


def path_losses() -> Differences:
    """Ours less ns-3's, dB, of each law by ns-3's name."""
    by_law: dict[str, list[float]] = {}
    for row in rows("ns3_path_loss.csv"):
        tx, rx = float(row["height_tx_m"]), float(row["height_rx_m"])
        slant = np.hypot(float(row["distance_m"]), tx - rx)
        where = Path(float(row["frequency_hz"]) or 1e9, slant, tx, rx)  # a law without frequency has 0 there
        with warnings.catch_warnings(action="ignore", category=ValidityWarning):
            loss = float(law(row["model"]).path_loss_db(where))
        by_law.setdefault(row["model"], []).append(loss - float(row["loss_db"]))
    return {name: np.array(found) for name, found in sorted(by_law.items())}


def error_rates() -> Differences:
    """Our probability of success less ns-3's, of each OFDM model and rate."""
    by_mode: dict[str, list[float]] = {}
    for row in rows("ns3_error_rate.csv"):
        rate = row["mode"].removeprefix("OfdmRate").removesuffix("Mbps")
        model = OFDM[row["error_model"]](rate_mbps=int(rate))
        lost = float(model.per(np.asarray(float(row["snr_db"])), float(row["bits"]) / 8.0, Band(20e6, 6e6)))
        difference = 1.0 - lost - float(row["success_probability"])
        by_mode.setdefault(f"{row['error_model']} {rate} Mb/s", []).append(difference)
    return {name: np.array(found) for name, found in sorted(by_mode.items())}


def rows(name: str) -> list[dict[str, str]]:
    """The rows of a table of values."""
    with (DATA / name).open() as file:
        return list(csv.DictReader(file))


def law(name: str) -> PathLossModel:
    """Our law for a name of ns-3's table."""
    if name in PLAIN:
        return PLAIN[name]
    family, environment, city = name.rsplit("-", 2)
    return HATA[family](environment=environment, city=city, outside="warn", coefficients="ns3")


def main(_: list[str]) -> None:
    """Print the largest difference of each law."""
    for title, differences in (("path loss, dB", path_losses()), ("probability of success", error_rates())):
        print(f"{title:32} values  largest difference")
        for name, found in differences.items():
            print(f"  {name:30} {found.size:6}  {np.max(np.abs(found)):.1e}")


if __name__ == "__main__":
    main([])
