"""How many files a run may have open at a time: systems allow a process 256 to 1024 unless it asks for more."""

from __future__ import annotations

import resource
from math import inf

from bridge.fleet.course import FleetError
from bridge.fleet.how import how_joined
from bridge.scenario.model import Scenario

OF_A_RUN, OF_A_GROUND_NODE, OF_A_UA = 32, 4, 9
"""Files that are open for certain in a run of one process: logs, streams, sockets and locks."""
ASKED_FOR_A_RUN, ASKED_FOR_A_NODE = 256, 32
"""Those that may be, as agents keep files, too, and clients come."""


def ask_for_open_files(nodes: int) -> None:
    """Have the system allow this process, and those that it starts, as many as a run of so many nodes may need."""
    now, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    asked = min(ASKED_FOR_A_RUN + ASKED_FOR_A_NODE * nodes, _number(most))
    if asked > _number(now):
        resource.setrlimit(resource.RLIMIT_NOFILE, (int(asked), most))


def allow_open_files(scenario: Scenario) -> None:
    """As `ask_for_open_files`, of a run that is to begin.

    Raises:
        FleetError: the system does not allow what the run needs for certain; the text says what to do.
    """
    ground, ua = len(scenario.ground), len(scenario.ua)
    ask_for_open_files(ground + ua)
    most = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
    needed = OF_A_RUN + OF_A_GROUND_NODE * ground + OF_A_UA * ua
    if how_joined(scenario) == "one" and needed > _number(most):
        raise FleetError(
            f"in one process the run has {needed} files open, and the system allows {most}: "
            "raise it (ulimit -Hn), or fly it in many processes (--processes many)"
        )


def _number(limit: int) -> float:
    return inf if limit == resource.RLIM_INFINITY else limit
