"""Messages of a fleet that never was, for tests of what is shown of one."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from bridge.bus.messages import Clock, Fates, Header, Links, Truth, Truths, Vector3
from lostlink.view.picture.fleet_view import EmitterInfo, FleetView, NodeInfo

CAUSES = ("delivered", "channel_erasure", "out_of_range")
NS = 1_000_000_000


def view_of_two(duration_s: float = 60.0, now_s: Callable[[], float] = lambda: 0.0) -> FleetView:
    """A UA and a ground node."""
    nodes = [NodeInfo("0", "ua", "UA 0", "f450"), NodeInfo("gcs", "ground", "node gcs")]
    return FleetView(nodes, duration_s, now_s=now_s)


def with_emitter() -> FleetView:
    """The two, and an emitter."""
    return FleetView(view_of_two().nodes, 60.0, [EmitterInfo("beacon", 433.92e6, 18.0)])


def emitter_at(north_m: float) -> Truths:
    """The emitter at a place."""
    return Truths(
        Header.at(0, ""), (Truth(Header.at(0, "beacon"), position_ned_m=Vector3(north_m, 2.0, -3.0)),)
    )


def clock(time_s: float, *, paused: bool = False) -> Clock:
    """The fleet stands at a tick."""
    return Clock(Header.at(round(time_s * NS), ""), 1.0, 1.0, paused)


def truths(time_s: float, north_m: float) -> Truths:
    """UA 0 at a place, the ground node at the origin."""
    at = round(time_s * NS)
    ua = Truth(
        Header.at(at, "0"), position_ned_m=Vector3(north_m, 2.0, -40.0), wind_ned_mps=Vector3(1.0, -2.0, 0.0)
    )
    return Truths(Header.at(at, ""), (ua, Truth(Header.at(at, "gcs"))))


def links(time_s: float, distance_m: float, per: float, sent: int, delivered: int) -> Links:
    """A report of the link from UA 0 to the ground node."""
    header, figures = Header.at(round(time_s * NS), ""), ((distance_m,), (-80.0,), (12.0,), (per,))
    return Links(
        header, ("0", "gcs"), (0,), (1,), *figures, (sent,), (delivered,), network=("main",), radio=(0,)
    )


def fates(time_s: float, rows: Sequence[tuple[int, int, int]], nodes: Sequence[str] = ("0", "gcs")) -> Fates:
    """What became of packets: transmitter, receiver, place of the fate in CAUSES."""
    tx, rx, fate = zip(*rows, strict=True) if rows else ((), (), ())
    n = len(rows)
    at = round(time_s * NS)
    return Fates(
        Header.at(at, ""), tuple(nodes), CAUSES, tx, rx, tuple(range(n)), (at,) * n, (40,) * n,
        (100.0,) * n, (-80.0,) * n, (12.0,) * n, (0.1,) * n, bytes(fate), network=("main",), radio=(0,) * n,
    )  # fmt: skip
