"""Refused logins are found in Zenoh's log, as Zenoh 1.10 words it; the rest of the log goes on."""

from __future__ import annotations

import subprocess
import sys

import pytest

from bridge.bus.identity.logins import why_refused

PREFIX = (
    "2026-11-21T23:47:15.925037Z DEBUG acc-0 ThreadId(05) zenoh_transport::unicast::establishment::accept: "
)
SCRIPT = """\
import os, subprocess
from bridge.bus.identity.logins import LoginWatch

told = []
with LoginWatch(lambda *refusal: told.append(refusal), lambda number: told.append(number)):
    for line in {lines!r}:
        os.write(1, line.encode() + b"\\n")
    child = subprocess.Popen(["sleep", "60"], stderr=subprocess.DEVNULL)  # which has the log's end for its stdout
print(told)
child.kill()
"""


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("UsrPwd extension - Recv InitSyn. Expected extension. at usrpwd.rs:380.", "no_password"),
        ("UsrPwd extension - Recv OpenSyn. Invalid password. at usrpwd.rs:424.", "wrong_password"),
        ("UsrPwd extension - Recv OpenSyn. Invalid user. at usrpwd.rs:418.", "unknown_user"),
        ("New transport link accepted from 2e16 to 51d3", None),
    ],
)
def test_reasons(text: str, reason: str | None) -> None:
    assert why_refused(PREFIX + text) == reason


def test_log_of_a_process_is_read_and_passed_on() -> None:
    lines = [
        f"{PREFIX}\x1b[1mInvalid password\x1b[0m",
        "\x04",  # of an agent: nobody would read what follows, and the process would stand at its next 64 KiB
        "2026 ERROR zenoh: something else",
        f"{PREFIX}New transport link accepted",
        "2026 ERROR zenoh_transport::unicast::universal::tx: Unable to push non droppable network message to 5f4d. "
        "Closing transport!",
        f"{PREFIX}Invalid password",
    ]
    script = SCRIPT.format(lines=lines)
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=30, check=True
    )
    assert done.stdout.splitlines() == [
        "\x04",
        "2026 ERROR zenoh: something else",
        "[('wrong_password', 1), 1, ('wrong_password', 2)]",
    ]
