"""What a reply to a command says, whatever it is."""

from __future__ import annotations

import math

import zenoh

from bridge.bus.messages import CommandEvent, DecodeError, decode


def event_of(reply: zenoh.Reply) -> CommandEvent:
    """The event of a reply; a refusal, or what is no event, as a result that failed."""
    if reply.ok is None:
        text = reply.err.payload.to_string() if reply.err is not None else "no reply"
        return CommandEvent(CommandEvent.RESULT, False, text, math.nan)
    try:
        return decode(reply.ok.payload.to_bytes(), CommandEvent)
    except DecodeError as error:
        return CommandEvent(CommandEvent.RESULT, False, str(error), math.nan)
