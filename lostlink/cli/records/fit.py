"""`lostlink fit`: from a run, a table, or the logs of the two ends of a flight."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from channel.cli.fit_command import FitRequest, fit_options, run_fit
from channel.cli.options import BadInput
from channel.config import RadioConfig
from lostlink.cli.run_path import RunPath

if TYPE_CHECKING:
    from aps.logs.flight_log import LoggedPlace
    from channel.fit.flight_log import FlightLog

AUTOPILOT_LOGS = frozenset({".tlog", ".bin", ".ulg"})


@click.command()
@click.argument("log", type=RunPath())
@click.argument("sent", required=False, type=click.Path(dir_okay=False, path_type=Path))
@click.option("--sender", "sender_sysid", type=click.IntRange(1, 255), help="MAVLink system of the sender.")
@click.option(
    "--receiver-at", metavar="LAT,LON,ALT", help="Where the receiver stood: degrees, m above sea level."
)
@click.option(
    "--rssi-scale",
    type=click.Choice(["sik", "dbm"]),
    default="sik",
    show_default=True,
    help="Unit of RADIO_STATUS.rssi: SiK's, or dBm as a signed byte.",
)
@click.option(
    "--network", default="main", show_default=True, help="Of a run with several radio networks, which."
)
@fit_options
def fit(
    log: Path,
    sent: Path | None,
    sender_sysid: int | None,
    receiver_at: str | None,
    rssi_scale: str,
    network: str,
    **options: Any,
) -> None:
    """Fit a radio to a flight: to a table of packets, or to the LOG of the receiver and that of the sender, SENT.

    A table is the directory of a run, a Parquet file or a CSV. It has one row per packet: distance_m (or positions, in
    a CSV), delivered or fate, and optional rssi_dbm and length_bytes. Otherwise LOG is a .tlog recorded at the
    receiving end, and SENT the sender's own .tlog or .bin.

    The radio to start from needs log-distance propagation and normal, gudmundson or one-sided-normal shadowing; it
    gives the error model, powers and gains. Whether the shadowing is correlated along the track, and whether packets
    fade (Rice), is found from the log.
    Prints each parameter with its 95 % interval, or that the data do not determine it. A run has no RSSI: where its
    shadowing is correlated along the track, as the default radio's is, no interval is given.

    \b
    Examples:
      lostlink fit flight.csv --radio corrected --out mine.yaml --plot fit.png
      lostlink fit runs/20261121T120000Z-separation --radio corrected --hold propagation.exponent
      lostlink fit flight.csv --radio corrected --hold shadowing.sigma_db --json
      lostlink fit ground.tlog ua1.bin --radio corrected --receiver-at 40.13,-105.24,1580 --out mine.yaml
      lostlink link --radio mine.yaml --ground-distance 300         what the fitted radio does
    """
    request = FitRequest(**options)
    if sent is None and log.suffix.lower() in AUTOPILOT_LOGS:
        raise BadInput(
            f"{log}: the sender's own log (.tlog or .bin) is missing: it says where the sender was"
        )
    if sent is None and log.is_dir():
        run_fit(request, log.name, lambda base: _from_run(base, log, network))
        return
    if sent is None:
        from channel.fit.columns import read_log

        run_fit(request, log.stem, lambda base: read_log(log, base, network))
        return
    place = None if receiver_at is None else _place(receiver_at)
    run_fit(request, log.stem, lambda base: _from_logs(base, log, sent, sender_sysid, place, rssi_scale))


def _from_run(base: RadioConfig, run: Path, network: str) -> FlightLog:
    from bridge.record.tables.deliveries import DELIVERIES
    from bridge.record.tables.reader import read_columns
    from channel.fit.columns import log_of_columns

    names = ("distance_m", "fate", "length_bytes", "tx", "rx", "radio", "attempts")
    try:
        columns = read_columns(run, DELIVERIES, names)
    except (OSError, ValueError) as error:
        raise BadInput(str(error)) from error
    return log_of_columns(columns, base, str(run), network)


def _from_logs(
    base: RadioConfig, log: Path, sent: Path, sender: int | None, place: LoggedPlace | None, rssi_scale: str
) -> FlightLog:
    import numpy as np

    from aps.logs import flight_log as aps_log
    from channel.fit.flight_log import FlightLog

    try:
        link = aps_log.read_link(log, sent, sender_sysid=sender, receiver_at=place, rssi_scale=rssi_scale)
    except aps_log.AutopilotLogError as error:
        raise BadInput(str(error)) from error
    counted = {int(length): float(base.length.length_bytes(int(length))) for length in set(link.length_bytes)}
    lengths = np.array([counted[int(length)] for length in link.length_bytes])
    return FlightLog(link.distance_m, link.delivered, lengths, link.rssi_dbm)


def _place(text: str) -> LoggedPlace:
    from aps.logs.flight_log import LoggedPlace

    try:
        lat, lon, alt = (float(part) for part in text.split(","))
    except ValueError as error:
        raise BadInput(f"--receiver-at {text!r}: three numbers, as in 40.13,-105.24,1580") from error
    if not (abs(lat) <= 90.0 and abs(lon) <= 180.0 and abs(alt) <= 1e5):
        raise BadInput(f"--receiver-at {text!r}: degrees within 90 and 180, metres")
    return LoggedPlace(lat, lon, alt)
