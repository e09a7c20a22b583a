"""The end of an attached program."""

from __future__ import annotations

import asyncio
import signal
from typing import cast

import pytest

from lostlink.attach import serve
from lostlink.attach.forwarder import Forwarder
from lostlink.attach.plan import AttachPlan
from lostlink.attach.program import AttachedProgram


class Stubborn:
    """A program that cannot be asked to end."""

    def __init__(self) -> None:
        self.killed = asyncio.Event()

    def end(self) -> None:
        raise PermissionError

    def kill(self) -> None:
        self.killed.set()


async def test_force_follows_whatever_comes_of_asking(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(serve, "GRACE_S", 0.01)
    program = Stubborn()
    attached = serve._Attached(
        cast(AttachPlan, None), cast(AttachedProgram, program), cast(Forwarder, None), print, print
    )
    with pytest.raises(PermissionError):
        attached._came(signal.SIGTERM)
    async with asyncio.timeout(10.0):
        await program.killed.wait()
