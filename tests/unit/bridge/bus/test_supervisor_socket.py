"""What a supervisor says to the program of a run: go, or nothing."""

from __future__ import annotations

import asyncio
import socket

import pytest

from bridge.bus.supervisor_socket import GO, SupervisorSocket


@pytest.mark.parametrize("says", [True, False])
async def test_go_is_not_the_end_of_the_supervisor(says: bool) -> None:
    ours, theirs = socket.socketpair()
    with theirs:
        waits = asyncio.create_task(SupervisorSocket(theirs.fileno()).told_to_go())
        await asyncio.sleep(0)
        assert not waits.done()
        with ours:
            if says:
                ours.send(GO)
        assert await asyncio.wait_for(waits, 10.0) is says
