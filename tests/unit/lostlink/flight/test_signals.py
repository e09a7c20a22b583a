"""Which signals end a command."""

from __future__ import annotations

import signal
import subprocess
import sys

import pytest

from lostlink.flight.signals import ending_signals


@pytest.mark.parametrize(("before", "ends"), [(signal.SIG_DFL, True), (signal.SIG_IGN, False)])
def test_a_terminal_that_goes_ends_it_unless_that_is_to_be_outlived(
    before: signal.Handlers, ends: bool
) -> None:
    kept = signal.signal(signal.SIGHUP, before)
    try:
        assert (signal.SIGHUP in ending_signals()) is ends
    finally:
        signal.signal(signal.SIGHUP, kept)


def test_outputs_that_were_closed_on_purpose_are_left_alone() -> None:
    """`lostlink run >&-`: a signal still ends it in order."""
    code = "import os; os.close(1); from lostlink.flight.signals import leave_terminal; leave_terminal()"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
