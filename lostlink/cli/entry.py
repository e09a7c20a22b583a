"""Where the command `lostlink` begins: an interruption ends it with a line, also while it loads."""

from __future__ import annotations

import os
import signal
import sys

from lostlink.flight.signals import ending_signals, leave_terminal

FLYING = ("run", "refly")


def main() -> None:
    """Run the command. One that flies replaces the way it ends by its own, orderly one."""
    for number in ending_signals():
        signal.signal(number, _end)
    from lostlink.cli.main import main as command

    command()


def _end(number: int, _: object) -> None:
    """End at once: whatever is being imported could swallow an exception."""
    when = " before the run began" if sys.argv[1:2] and sys.argv[1] in FLYING else ""
    leave_terminal()
    os.write(2, f"lostlink: interrupted{when}\n".encode())
    os._exit(128 + number)


if __name__ == "__main__":
    main()
