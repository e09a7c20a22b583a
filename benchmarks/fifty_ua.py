"""Fifty UA at ten ticks a second: messages as a run has them, for tests and the benchmark of the view."""

from __future__ import annotations

import numpy as np

from bridge.bus.messages import Clock, Fates, Header, Links, Message, Quaternion, Truth, Truths, Vector3
from lostlink.view.picture.fleet_view import FleetView, NodeInfo

NODES = 50
TICK_NS = 100_000_000
IDS = tuple(str(number) for number in range(NODES))
TX, RX = (ends.astype(np.uint16) for ends in np.nonzero(~np.eye(NODES, dtype=bool)))


def fifty() -> FleetView:
    """The empty picture."""
    return FleetView([NodeInfo(node, "ua", f"UA {node}", "f450") for node in IDS], 600.0)


def messages_of(tick: int) -> list[Message]:
    """All that a tick publishes: everybody circles, everybody transmits, far ones lose."""
    at_ns = tick * TICK_NS
    header = Header.at(at_ns, "")
    angle = 0.02 * tick + np.arange(NODES) * 0.7
    radius_m = 60.0 + 12.0 * np.arange(NODES)
    places = np.stack((radius_m * np.cos(angle), radius_m * np.sin(angle), -30.0 - np.arange(NODES)), axis=1)
    distance_m = np.linalg.norm(places[TX] - places[RX], axis=1)
    per = 1.0 / (1.0 + np.exp((500.0 - distance_m) / 60.0))
    fate = (per > (TX * 7.0 + RX * 13.0 + tick) % 97 / 97.0).astype(np.uint8)
    power, snr = -60.0 - distance_m / 10.0, 40.0 - distance_m / 10.0
    count = np.full(len(TX), tick + 1)
    truths = tuple(
        Truth(
            Header.at(at_ns, node),
            position_ned_m=Vector3(*place),
            attitude=Quaternion(0.0, 0.0, 0.3, 0.95),
            wind_ned_mps=Vector3(2.0, 3.0, 0.0),
        )
        for node, place in zip(IDS, places.tolist(), strict=True)
    )
    sent = (TX, RX, count, count * TICK_NS, np.full(len(TX), 40, dtype=np.uint32))
    figures = (distance_m, power, snr, per)
    fates = Fates(
        header,
        IDS,
        ("delivered", "channel_erasure"),
        *sent,
        *figures,
        fate.tobytes(),
        network=("main",),
        radio=np.zeros_like(TX),
    )
    found: list[Message] = [Clock(header, 1.0, 1.0), Truths(header, truths), fates]
    if tick % 2 == 0:
        counts = (count.astype(np.uint64), (count * (1.0 - per)).astype(np.uint64))
        found.append(
            Links(header, IDS, TX, RX, *figures, *counts, network=("main",), radio=np.zeros_like(TX))
        )
    return found
