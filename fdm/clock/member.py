"""One UA of a fleet clock."""

from __future__ import annotations


class Member:
    """One UA as the fleet clock sees it. Only the clock writes to it.

    Attributes:
        ua_id: which UA.
        sim_time_ns: its fleet sim time.
        target_ns: where its next step leads; meaningful while `waiting`.
        live: others wait for it.
        waiting: it has asked for a step.
        quiet: so it has, and its autopilot is blocked until it is answered (so it cannot stall).
        joined: it has joined at least once.
        ended: it is out for good.
    """

    __slots__ = (
        "ended",
        "idle_ns",
        "joined",
        "live",
        "quiet",
        "sim_time_ns",
        "target_ns",
        "ua_id",
        "waiting",
    )

    def __init__(self, ua_id: int) -> None:
        self.ua_id = ua_id
        self.sim_time_ns = 0
        self.target_ns = 0
        self.live = False
        self.waiting = False
        self.quiet = False
        self.joined = False
        self.ended = False
        self.idle_ns = 0
