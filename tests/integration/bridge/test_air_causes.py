"""What the record says why packets were lost on media that take time, and how often they were on the air."""

from __future__ import annotations

from tests.integration.bridge.test_air import RADIO, Flown, balances, flown, node, rows

__all__ = ["flown"]
FAINT = RADIO | {"error": {"model": "threshold", "snr_min_db": 40.0}}
"""45 dB over noise at 1 km, 36 at 3 km: what comes from there is locked on to, and lost."""


def test_a_frame_that_noise_takes_is_no_collision_whatever_it_meets(flown: Flown) -> None:
    """All at once: node 0 follows the nearest, and would have had that at 1 km alone, but not that at 3 km."""
    sends = [(1.0, "0", 100)]
    nodes = [
        node(0, 0.0),
        *(node(n, far_m, sends=sends) for n, far_m in ((1, 100.0), (2, 1000.0), (3, 3000.0))),
    ]
    run = flown(nodes, {"model": "airtime"}, radio=FAINT)
    found = {sender: rows(run, sender, "0").fate.tolist() for sender in ("g1", "g2", "g3")}
    assert found == {"g1": ["collided"], "g2": ["collided"], "g3": ["channel_erasure"]}
    assert balances(run)


def test_a_frame_that_another_displaces_is_no_collision_if_noise_takes_it(flown: Flown) -> None:
    """That from 3 km comes first; what takes the receiver over is 29.5 dB stronger, 40 have to be."""
    nodes = [
        node(0, 0.0),
        node(1, 100.0, sends=[(1.005, "0", 100)]),
        node(3, 3000.0, sends=[(1.0, "0", 100)]),
    ]
    run = flown(nodes, {"model": "airtime", "capture_db": 10.0}, radio=FAINT, tick_rate_hz=100)
    assert rows(run, "g3", "0").fate.tolist() == ["channel_erasure"]
    assert rows(run, "g1", "0").fate.tolist() == ["collided"]


def test_a_frame_that_an_emitter_takes_is_interfered_whatever_it_meets(flown: Flown) -> None:
    """-80 dBm from 9 km, against -72 dBm from 1 km: lost to that; noise alone would take what comes from 3 km."""
    jammer = {"id": "j", "kind": "emitter", "place": {"north_m": 9000.0, "height_m": 10.0}}
    jammer |= {"frequency_hz": 915e6, "power_dbm": 31.0}
    sends = [(1.0, "0", 100)]
    nodes = [
        node(0, 0.0),
        *(node(n, far_m, sends=sends) for n, far_m in ((1, 10.0), (2, 1000.0), (3, 3000.0))),
    ]
    run = flown([*nodes, jammer], {"model": "airtime"}, radio=FAINT)
    found = {sender: rows(run, sender, "0").fate.tolist() for sender in ("g1", "g2", "g3")}
    assert found == {"g1": ["collided"], "g2": ["interfered"], "g3": ["channel_erasure"]}
