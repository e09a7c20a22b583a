"""Which process of this machine is at the other end of a TCP connection."""

from __future__ import annotations

import socket
import sys


def process_at_end(connection: socket.socket) -> int | None:
    """Id of the process that has the other end; None: it is on another machine, or somebody else's."""
    if sys.platform != "linux":
        return None
    import psutil

    ours, theirs = connection.getsockname()[:2], connection.getpeername()[:2]
    try:
        for other in psutil.net_connections("tcp4"):
            if other.laddr == theirs and other.raddr == ours:
                return other.pid
    except psutil.Error:
        return None
    return None
