"""PictureFrames to all viewers at a steady pace, by wall time: made once, and a slow viewer gets fewer."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from starlette.websockets import WebSocket

from aps.api.serving import serve_client
from lostlink.view.picture.frames import PictureFrames

FRAME_PERIOD_S = 0.1
VIEWERS_MAX = 16
TRY_AGAIN_LATER = 1013
"""WebSocket close code."""


class Viewer:
    """One browser: holds the newest frame until the one before is gone."""

    def __init__(self) -> None:
        self._waiting: str | None = None
        self._news = asyncio.Event()
        self.missed = 0
        """PictureFrames that came too fast: then a snapshot has to follow."""

    def put(self, frame: str) -> bool:
        """Have a frame sent; False if the one before still waits, and both are dropped."""
        if self._waiting is not None:
            self.missed += 1
            self._waiting = None
            return False
        self._waiting = frame
        self._news.set()
        return True

    async def next(self) -> str:
        """The next text to send."""
        while self._waiting is None:
            self._news.clear()
            await self._news.wait()
        text, self._waiting = self._waiting, None
        return text


class Broadcast:
    """All viewers.

    Args:
        frames: makes the frames.
        on_viewers: called with their number when it changes.
    """

    def __init__(self, frames: PictureFrames, on_viewers: Callable[[int], object]) -> None:
        self._frames = frames
        self._on_viewers = on_viewers
        self._viewers: list[Viewer] = []
        self._behind: set[Viewer] = set()

    async def run(self) -> None:
        """Send frames until cancelled; none is made when nobody looks."""
        while True:
            if self._viewers:
                self._send()
            await asyncio.sleep(FRAME_PERIOD_S)

    def _send(self) -> None:
        if self._frames.begins_anew():
            self._behind.update(self._viewers)
        frame, snapshot = self._frames.frame(), ""
        for viewer in self._viewers:
            text = frame
            if viewer in self._behind:
                text = snapshot = snapshot or self._frames.snapshot()
            if viewer.put(text):
                self._behind.discard(viewer)
            else:
                self._behind.add(viewer)

    async def serve(self, socket: WebSocket) -> None:
        """Serve one viewer until it goes."""
        await socket.accept()
        if len(self._viewers) >= VIEWERS_MAX:
            await socket.close(TRY_AGAIN_LATER, f"{VIEWERS_MAX} pages show the map already: this one waits")
            return
        viewer = Viewer()
        self._viewers.append(viewer)
        self._behind.add(viewer)  # it begins with a snapshot
        self._on_viewers(len(self._viewers))
        try:
            await serve_client(socket, self._feed(viewer, socket))
        finally:
            self._viewers.remove(viewer)
            self._behind.discard(viewer)
            self._on_viewers(len(self._viewers))

    async def _feed(self, viewer: Viewer, socket: WebSocket) -> None:
        while True:
            await socket.send_text(await viewer.next())
