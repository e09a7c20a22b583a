"""What Zenoh lets its router see of those whom it refuses, and of readers that it cuts off: in its log.

Zenoh (1.10) reports refused logins in its log only, without the user, and refused messages only at its level `trace`,
beside each message that it lets pass. So the log is read for logins here, and for readers that were too slow, and
``RUST_LOG=zenoh::net::routing::interceptor::access_control=trace`` writes everything else to the router's own log.
"""

from __future__ import annotations

import os
import re
import secrets
import threading
from collections import Counter
from collections.abc import Callable
from typing import Final, Self

import zenoh

VARIABLE: Final = "RUST_LOG"
NEEDED: Final = ",".join(
    (
        "zenoh_transport::unicast::establishment::accept=debug",
        "zenoh::net::routing::interceptor::access_control=info",
        "zenoh_transport::unicast::universal::tx=error",
    )
)
"""Zenoh is asked to log this; it prints a line for each login, none for a message."""
DEFAULT: Final = "error"
STDOUT = 1
END: Final = "\x04"
"""Begins the last line that is read; a number follows that is in no line of agents, whose prints come here, too."""
NO_PASSWORD = "no_password"
WRONG_PASSWORD = "wrong_password"
UNKNOWN_USER = "unknown_user"
NO_RIGHTS = "no_rights"
"""Logged in from where the user has no rights: an observer from another machine."""
_SAYINGS: Final = {
    "Recv InitSyn. Expected extension": NO_PASSWORD,
    "Invalid password": WRONG_PASSWORD,
    "Invalid user": UNKNOWN_USER,
    "did not match any configured ACL subject": NO_RIGHTS,
}
_CUT_OFF: Final = "Unable to push non droppable network message"
_EXPECTED = re.compile(r"unicast::establishment::accept: ")
_COLOUR = re.compile(r"\x1b\[[0-9;]*m")


def why_refused(line: str) -> str | None:
    """The reason, if a line of Zenoh's log reports a refused login."""
    return next((reason for text, reason in _SAYINGS.items() if text in line), None)


class LoginWatch:
    """Reads Zenoh's log, which goes to the process's stdout, as long as it is entered; once per process.

    Args:
        on_refused: called with the reason and how often there was that reason, in a thread of this watch.
        on_cut_off: called, there too, when the router has closed the connection of a reader whose queue stayed full,
            with how often it has.
    """

    def __init__(
        self, on_refused: Callable[[str, int], object], on_cut_off: Callable[[int], object] = lambda _: None
    ) -> None:
        self._on_refused, self._on_cut_off = on_refused, on_cut_off
        self._cut_off = 0
        self._refused: Counter[str] = Counter()
        self._end = f"{END}{secrets.token_hex(8)}\n"
        self._thread = threading.Thread(target=self._read, name="login watch", daemon=True)

    def __enter__(self) -> Self:
        read, write = os.pipe()
        self._stdout, self._pipe = os.dup(STDOUT), os.fdopen(read, encoding="utf-8", errors="replace")
        os.dup2(write, STDOUT)
        os.close(write)
        self._thread.start()
        os.environ[VARIABLE] = f"{NEEDED},{os.environ.get(VARIABLE, DEFAULT)}"
        zenoh.init_log_from_env_or(DEFAULT)
        return self

    def __exit__(self, *_: object) -> None:
        # Processes that an agent has started may have the pipe's other end, too.
        os.write(STDOUT, self._end.encode())
        os.dup2(self._stdout, STDOUT)
        self._thread.join()
        self._pipe.close()
        os.close(self._stdout)

    def _read(self) -> None:
        for coloured in self._pipe:
            text, end, _ = coloured.partition(self._end)
            self._take(_COLOUR.sub("", text))
            if end:
                return

    def _take(self, line: str) -> None:
        reason = why_refused(line)
        if reason is not None:
            self._refused[reason] += 1
            self._on_refused(reason, self._refused[reason])
        elif _CUT_OFF in line:
            self._cut_off += 1
            self._on_cut_off(self._cut_off)
        elif not _EXPECTED.search(line):
            os.write(self._stdout, line.encode())
