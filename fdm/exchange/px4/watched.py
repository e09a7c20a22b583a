"""Has a PX4 that has connected fly so that it repeats, as far as that can be done, and says why it cannot."""

from __future__ import annotations

from collections.abc import Sequence

from fdm.exchange.px4.one_core import (
    keep_on_one_core,
    may_run_in_order,
    our_cores,
    runs_in_order,
    their_cores,
)
from fdm.exchange.px4.peer import READER, Peer
from fdm.exchange.px4.quiet import Rest, shows_rest

BY_WALL_TIME = "starts_by_wall_time"
"""Counter of the connections of a PX4 that we cannot see the threads of."""
THROUGH_ANOTHER = "starts_through_another_process"
"""Counter of the connections of a process of this machine that is no PX4."""
NOT_SHOWN = "starts_with_rest_not_shown"
"""Counter of the connections of a PX4 on a system that does not show when threads run."""
ON_MANY_CORES = "starts_on_many_cores"
"""Counter of the connections of a PX4 that we cannot keep on one core."""
OUT_OF_ORDER = "starts_without_real_time_threads"
"""Counter of the connections of a PX4 that may not have real-time threads."""
BEFORE_REST = "frames_sent_before_rest"
"""Counter of the frames that were sent before PX4 was at rest."""
WHY_NOT = {
    BY_WALL_TIME: "its PX4 runs on another machine, or as another user: when it is done with a frame cannot be seen",
    THROUGH_ANOTHER: "what has connected is no PX4 but a program between (a relay, a tunnel): when PX4 is done with a "
    "frame cannot be seen",
    NOT_SHOWN: "this system does not show when threads run (schedstat, wchan and children in /proc): when its PX4 is "
    "done with a frame cannot be seen",
    ON_MANY_CORES: "its PX4 could not be kept on one core: the order of its threads is the machine's",
    OUT_OF_ORDER: "its PX4 may not have real-time threads (root, CAP_SYS_NICE or `ulimit -r 99`): their order is the "
    "machine's",
    BEFORE_REST: "its PX4 was sent a frame though it had not come to rest within half a second of wall time",
}
"""Why a flight may not repeat, by counter."""
WHILE_IT_STARTS = (
    "PX4's start script goes on when a module's thread is there: one that has to wait for the disk first, as beside "
    "much writing, comes a frame later"
)
"""Why none of its flights is sure to repeat."""


def watch(peer: Peer, which: int, cores: Sequence[int]) -> tuple[Rest | None, str]:
    """Keep a PX4 on one core, and see when it is at rest.

    Args:
        peer: who has connected.
        which: see `keep_on_one_core`.
        cores: those of the exchange.

    Returns:
        What sees it, None: nothing can; and a key of WHY_NOT, empty: the flight repeats.
    """
    if peer.pid is None:
        return None, BY_WALL_TIME
    if not peer.is_px4:
        return None, THROUGH_ANOTHER
    is_kept = keep_on_one_core(peer.pid, which, their_cores(cores))
    if not shows_rest():
        return None, NOT_SHOWN
    rest = Rest(peer.pid, READER)
    if not is_kept:
        return rest, ON_MANY_CORES
    return rest, "" if runs_in_order(peer.pid) else OUT_OF_ORDER


def why_not_here() -> list[str]:
    """Why flights of a PX4 that is started on this machine, as this user, may not repeat, as far as can be known."""
    found = {NOT_SHOWN: shows_rest(), ON_MANY_CORES: bool(our_cores()), OUT_OF_ORDER: may_run_in_order()}
    return [WHY_NOT[counter] for counter, is_fine in found.items() if not is_fine]
