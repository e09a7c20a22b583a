"""What `lostlink link` says about one link, as data and as text."""

from __future__ import annotations

from typing import Any, Unpack

import numpy as np

from channel.access.settings.medium import up_share_of
from channel.config import RadioConfig
from channel.link.paths import Geometry
from channel.link.radio import Radio

Report = dict[str, Any]


def link_report(config: RadioConfig, length_bytes: int | None = None, **ends: Unpack[Geometry]) -> Report:
    """Return the link budget of one link, term by term, and what follows from it.

    Keys: radio, description, laws (what each of its models is called), frequency_hz, distance_m (over the ground),
    slant_distance_m, length_bytes, terms (name and contribution, in order, their sum is the received power),
    path_loss_db, received_power_dbm, noise_floor_dbm, preamble_dbm (the weakest signal that receivers lock on to;
    None if the error rate alone decides), snr_db, ber, per (these without shadowing and fading), in_range, base_loss,
    probability_of_delivery (averaged over the random terms), probability_error_bound and outage_share (of
    packets, which the medium's outages take besides).

    Args:
        config: the radio.
        length_bytes: payload; the radio's nominal one if not given.
        **ends: ground_distance_m, height_tx_m, height_rx_m, frequency_hz, base as in `Radio.path`.

    Raises:
        ChannelInputError: a value out of range.
    """
    radio = Radio(config)
    link = radio.link(length_bytes=length_bytes, **ends)
    delivery = radio.delivery(length_bytes=length_bytes, **ends)
    return {
        "radio": config.name,
        "description": config.description,
        "laws": config.laws,
        "frequency_hz": float(np.asarray(ends.get("frequency_hz") or config.frequency_hz)),
        "distance_m": float(np.asarray(ends["ground_distance_m"])),
        "slant_distance_m": float(link.distance_m),
        "length_bytes": int(link.length_bytes),
        "terms": [{"name": term.name, "contribution": float(term.contribution)} for term in link.terms],
        "path_loss_db": float(link.path_loss_db),
        "received_power_dbm": float(link.received_power_dbm),
        "noise_floor_dbm": float(link.noise_dbm),
        "preamble_dbm": radio.locks_from_dbm if radio.needs_preamble else None,
        "snr_db": float(link.snr_db),
        "ber": float(link.ber),
        "per": float(link.per),
        "in_range": bool(link.in_range),
        "base_loss": link.base_loss,
        "probability_of_delivery": float(delivery.probability),
        "probability_error_bound": float(delivery.error_bound),
        "outage_share": 1.0 - up_share_of(config.medium),
    }


def link_text(report: Report) -> str:
    """Return the report for a terminal: the terms, their sum, then the error rates."""
    head = f"{report['radio']}: {report['description']}"
    where = (
        f"{report['distance_m']:g} m, {report['frequency_hz'] / 1e6:g} MHz, {report['length_bytes']} bytes"
        + ("" if report["in_range"] else "   (out of range)")
    )
    terms = [(term["name"], f"{term['contribution']:+12.4f}") for term in report["terms"]]
    results = [
        ("= received_power_dbm", f"{report['received_power_dbm']:+12.4f}"),
        ("noise_floor_dbm", f"{report['noise_floor_dbm']:+12.4f}"),
        ("snr_db", f"{report['snr_db']:+12.4f}"),
        ("ber", f"{report['ber']:12.4e}"),
        ("per", f"{report['per']:12.4e}"),
        ("probability_of_delivery", f"{report['probability_of_delivery']:12.4f}"),
    ]
    if report["preamble_dbm"] is not None:
        results.insert(2, ("preamble_dbm", f"{report['preamble_dbm']:+12.4f}"))
    rows = [f"  {name:<28}{value}" for name, value in terms + results]
    notes = ["", "  without shadowing and fading, but for the probability, which is averaged over them"]
    level_dbm = report["preamble_dbm"]
    if level_dbm is not None and report["received_power_dbm"] < level_dbm:
        notes.append("  too weak: receivers lock on to no signal below preamble_dbm (medium.preamble_dbm)")
    if report["outage_share"] > 0.0:
        notes.append(
            f"  outages of the medium take {100.0 * report['outage_share']:.3g} % of packets besides"
        )
    laws = ", ".join(f"{key} {name}" for key, name in report["laws"].items())
    return "\n".join([head, laws, where, "", *rows, *notes])
