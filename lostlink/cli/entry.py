"""Where the command `lostlink` begins: Ctrl-C ends it quietly from the first moment on, also while it loads."""

from __future__ import annotations

import signal


def main() -> None:
    """Run the command. `lostlink run` replaces the way it ends by its own, orderly one."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    from lostlink.cli.main import main as command

    command()


if __name__ == "__main__":
    main()
