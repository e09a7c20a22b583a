"""Draw what MAVSDK reported of a flight over the run's true track.

python mavsdk_watch.py tcpout://127.0.0.1:6760 246 > watch.txt    # during the run
python plot_track.py runs/20261122T034649Z-clients watch.txt track.png
"""

import re
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import pyarrow.parquet as pq

POSITION = re.compile(r"latitude_deg=(\S+), longitude_deg=(\S+), .*relative_altitude_m=([-\d.]+)")


def main(run, watch, picture):
    truth = pq.read_table(Path(run) / "truth.parquet").to_pydict()
    told = [tuple(map(float, found.groups())) for found in POSITION.finditer(Path(watch).read_text())]
    lat, lon, height = zip(*told, strict=True)
    figure, (plan, profile) = plt.subplots(1, 2, figsize=(9, 4), layout="constrained")
    plan.plot(truth["longitude_deg"], truth["latitude_deg"], color="0.75", lw=4, label="truth")
    plan.plot(lon[::4], lat[::4], "k.", ms=2, label="MAVSDK")
    plan.set(xlabel="longitude [°]", ylabel="latitude [°]")
    plan.ticklabel_format(useOffset=False)
    plan.tick_params("x", rotation=25)
    plan.legend()
    home_m = truth["altitude_amsl_m"][0]
    profile.plot(
        truth["latitude_deg"], [alt - home_m for alt in truth["altitude_amsl_m"]], color="0.75", lw=4
    )
    profile.plot(lat[::4], height[::4], "k.", ms=2)
    profile.set(xlabel="latitude [°]", ylabel="height above home [m]")
    profile.ticklabel_format(useOffset=False)
    profile.tick_params("x", rotation=25)
    figure.savefig(picture, dpi=110)


main(*sys.argv[1:])
