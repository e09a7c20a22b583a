"""Plays a record on Zenoh by wall time: one thread, which waits for the next tick or for somebody's wish."""

from __future__ import annotations

import json
import logging
import math
import queue
from collections.abc import Callable
from time import monotonic
from typing import Any

import zenoh

from bridge.bus.keys import Keys
from bridge.bus.session import Query, Session
from lostlink.replay.moment import Moment
from lostlink.replay.playing.controls import Controls
from lostlink.replay.playing.publisher import MomentPublisher

PAUSED_PERIOD_S = 1.0
"""How often the clock is published while nothing is played."""
ASKED_MAX = 1000
log = logging.getLogger("replay")


class ReplayProcess:
    """Publishes what `Controls` plays, and serves its verbs on ``clock/cmd/<verb>``.

    Args:
        session: where to.
        keys: under which prefix.
        controls: what is played.
        loop: begin anew at the end, for ever.
        on_moment: called with each moment that was played.
    """

    def __init__(
        self,
        session: Session,
        keys: Keys,
        controls: Controls,
        *,
        loop: bool = False,
        on_moment: Callable[[Moment], object] = lambda _: None,
    ) -> None:
        self._controls = controls
        self._loop = loop
        self._keys = keys
        self._on_moment = on_moment
        self._publisher = MomentPublisher(session, keys, controls.player.record.scenario)
        self._asked: queue.SimpleQueue[Query | None] = queue.SimpleQueue()
        session.serve(keys.clock_command("*"), self._take)

    def stop(self) -> None:
        """End `run`; callable from a signal handler: the queue takes no lock that `run` may hold."""
        self._asked.put(None)

    def run(self) -> None:
        """Play to the end, or until `stop`.

        Raises:
            ValueError, OSError: the record is damaged, or cannot be read any more.
        """
        while True:
            try:
                query = self._asked.get(timeout=self._patience_s())
            except queue.Empty:
                if not self._play():
                    return
            else:
                if query is None:
                    return
                self._do(query)

    def _patience_s(self) -> float:
        """How long to wait for a wish; nothing if the next tick is due."""
        if self._controls.player.now is None:
            return 0.0
        left_s = self._controls.due_s() - monotonic()
        return min(max(left_s, 0.0), PAUSED_PERIOD_S)

    def _play(self) -> bool:
        """Play what is due; returns whether to go on."""
        controls, now_s = self._controls, monotonic()
        if controls.player.now is not None and controls.due_s() > now_s:
            if controls.pace.paused:
                self._publisher.clock(controls.player.now, controls.pace)
            return True
        was = controls.player.now
        moment = controls.next(now_s)
        if moment is None and self._loop:
            moment = controls.rewind(now_s)
        if moment is None:
            if was is not None:
                self._publisher.end(was)
            return False
        self._publish(moment, everything=was is None or moment.sim_time_ns < was.sim_time_ns)
        return True

    def _publish(self, moment: Moment, *, everything: bool) -> None:
        self._publisher.publish(moment, self._controls.pace, everything=everything)
        self._on_moment(moment)

    # What is asked for.

    def _take(self, query: Query) -> None:
        """In Zenoh's own thread."""
        if self._asked.qsize() < ASKED_MAX:
            self._asked.put(query)
        else:
            query.drop()

    def _do(self, query: Query) -> None:
        verb = self._keys.last_chunk(str(query.key_expr))
        text = query.payload.to_bytes().decode(errors="replace") if query.payload else ""
        try:
            moment = self._controls.do(verb, text, monotonic())
        except ValueError as error:
            self._answer(query, verb, {"error": str(error)})
            return
        if moment is not None:
            self._publish(moment, everything=True)
        elif self._controls.player.now is not None:
            self._publisher.clock(self._controls.player.now, self._controls.pace)
        self._answer(query, verb, self._controls.status())

    def _answer(self, query: Query, verb: str, content: dict[str, Any]) -> None:
        payload, key = json.dumps(content).encode(), self._keys.clock_command(verb)
        try:
            if "error" in content:
                query.reply_err(payload, encoding="application/json")
            else:
                query.reply(key, payload, encoding="application/json")
            query.drop()
        except zenoh.ZError as error:
            log.warning("%s: whoever asked is gone: %s", verb, error)


def speed_text(speed: float) -> str:
    """For people."""
    return "as fast as can be" if math.isinf(speed) else f"{speed:g} times real time"
