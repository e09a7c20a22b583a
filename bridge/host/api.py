"""A node as the API sees it (`aps.api`): what comes over it takes effect at a tick, and is recorded as an input."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from typing import Any

from aps.api.backend import DaemonBackend
from aps.api.guard import ApiConfig
from aps.api.server import ApiServer
from aps.held import HeldDaemon
from aps.vehicle.execution import CommandProgress, CommandResult, Outcome
from bridge.bus.messages import CommandEvent, CommandGoal
from bridge.host.node import Node


class NodeBackend(DaemonBackend):
    """The API's view of a node: reads what its daemon knows, and commands as an operator does.

    Args:
        daemon: the node's daemon.
        node: the node.
    """

    def __init__(self, daemon: HeldDaemon, node: Node) -> None:
        super().__init__(daemon)
        self._node = node

    def start(
        self,
        verb: str,
        arguments: Mapping[str, Any],
        on_progress: Callable[[CommandProgress], None],
        on_done: Callable[[CommandResult], None],
    ) -> None:
        """Ask for a command: it starts at the next tick.

        Raises:
            ValueError: there is no such verb, or an argument is wrong.
        """
        self._daemon.commands.check(verb, arguments)

        def on_reply(event: CommandEvent) -> None:
            if event.phase == CommandEvent.RESULT:
                on_done(_result(verb, event))
            else:
                on_progress(_progress(verb, event))

        goal = CommandGoal(arguments=json.dumps(dict(arguments)) if arguments else "")
        self._node.operator_asked(verb, goal, on_reply)


def _result(verb: str, event: CommandEvent) -> CommandResult:
    outcome = Outcome(event.outcome) if event.outcome else Outcome.REFUSED
    reason = event.text.removeprefix(f"{verb} {outcome.value.replace('_', ' ')}").removeprefix(": ")
    return CommandResult(verb, outcome, reason, json.loads(event.value) if event.value else None)


def _progress(verb: str, event: CommandEvent) -> CommandProgress:
    return CommandProgress(
        verb,
        "accepted" if event.phase == CommandEvent.ACCEPTED else "feedback",
        event.text,
        None if math.isnan(event.remaining_m) else event.remaining_m,
        None if event.done < 0 else event.done,
        None if event.total < 0 else event.total,
        event.outcome == Outcome.REFUSED.value,
    )


def api_of(
    daemon: HeldDaemon, node: Node, port: int, on_failure: Callable[[BaseException], object]
) -> ApiServer:
    """The API of a node, on loopback; ``on_failure`` is called if it ends of itself."""
    return ApiServer(NodeBackend(daemon, node), ApiConfig(port=port), on_failure)
