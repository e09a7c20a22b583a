"""Runs a program that the kernel ends with its parent: ``python leash.py PARENT_PID PROGRAM ARGUMENT...``.

The wish has to be spoken between fork and exec, in the child. `subprocess` offers `preexec_fn` for that, which runs
Python in a fork of a process with threads and can deadlock (its documentation says so). So this small program is
started instead: it makes the wish, sees that its parent is still there, and becomes the program (prctl(2),
PR_SET_PDEATHSIG).
"""

import ctypes
import os
import signal
import sys

PR_SET_PDEATHSIG = 1


def end_with_parent() -> None:
    """Have the kernel end this process with its parent, where it can."""
    if sys.platform != "linux":
        return
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.prctl(PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0) != 0:
        print(f"leash: prctl: {os.strerror(ctypes.get_errno())}; goes on without", file=sys.stderr)


def main() -> None:
    """Make the wish, and become the program."""
    parent, command = int(sys.argv[1]), sys.argv[2:]
    end_with_parent()
    if os.getppid() != parent:
        sys.exit("leash: whoever started this is gone")
    try:
        os.execv(command[0], command)
    except OSError as error:
        sys.exit(f"leash: {command[0]}: {error.strerror}")


if __name__ == "__main__":
    main()
