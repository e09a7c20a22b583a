"""Replies to queries as events of a command: how they are given, and what they say, whatever they are."""

from __future__ import annotations

import logging
import math

import zenoh

from bridge.bus.messages import CommandEvent, DecodeError, decode, encode, encoding_of
from bridge.bus.session import Query, answer, end_of_answers

log = logging.getLogger("replies")


def reply_event(query: Query, key: str, event: CommandEvent) -> None:
    """Reply to a query on ``key``; a result is the last reply."""
    if not answer(query, key, encode(event), encoding_of(CommandEvent)):
        log.warning("%s: whoever asked is gone", key)
    elif event.phase == CommandEvent.RESULT:
        end_of_answers(query)


def event_of(reply: zenoh.Reply) -> CommandEvent:
    """The event of a reply; a refusal, or what is no event, as a result that failed."""
    if reply.ok is None:
        text = reply.err.payload.to_string() if reply.err is not None else "no reply"
        return CommandEvent(CommandEvent.RESULT, False, text, math.nan)
    try:
        return decode(reply.ok.payload.to_bytes(), CommandEvent)
    except DecodeError as error:
        return CommandEvent(CommandEvent.RESULT, False, str(error), math.nan)
