"""Who is at the other end of a TCP connection, as far as this machine can tell."""

from __future__ import annotations

import os
import socket
import sys
from typing import NamedTuple

from fdm.exchange.px4.quiet import names_of_threads

READER = "sim_rcv"
"""PX4's thread that connects to its simulator, and reads what that sends."""


class Peer(NamedTuple):
    """Who has connected.

    Attributes:
        pid: its process; None: it is on another machine, or somebody else's.
        is_px4: that process is a PX4, by the name of its reader.
    """

    pid: int | None = None
    is_px4: bool = False


def peer_of(connection: socket.socket) -> Peer:
    """Who has the other end.

    Raises:
        OSError: nobody has, any more.
    """
    pid = process_at_end(connection)
    return Peer(pid, pid is not None and pid != os.getpid() and READER in names_of_threads(pid))


def process_at_end(connection: socket.socket) -> int | None:
    """Id of the process that has the other end; None: it is on another machine, or somebody else's.

    Raises:
        OSError: nobody has, any more.
    """
    ours, theirs = connection.getsockname()[:2], connection.getpeername()[:2]
    if sys.platform != "linux":
        return None
    import psutil

    try:
        connections = psutil.net_connections("tcp4")
    except (psutil.Error, OSError):
        return None
    return next((other.pid for other in connections if other.laddr == theirs and other.raddr == ours), None)
