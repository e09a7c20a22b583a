"""The limits of wall time fit each other."""

from __future__ import annotations

from bridge import timeouts


def test_whoever_waits_for_another_waits_longer_than_the_other_may_take() -> None:
    assert timeouts.STALL_S < timeouts.SILENCE_S / 10
    assert timeouts.START_S < timeouts.SILENCE_S
    assert timeouts.LEASE_S > 2 * timeouts.SILENCE_S
    assert timeouts.COMMAND_QUERY_S > 7 * 86400
    assert timeouts.NEWS_PERIOD_S <= 2.0
    assert timeouts.AGENT_END_S + timeouts.OFFSPRING_END_S + timeouts.LEAVE_S < timeouts.AGENT_GRACE_S
