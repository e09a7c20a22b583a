"""How sessions are configured."""

from __future__ import annotations

import json

from bridge.bus.session import _config
from bridge.timeouts import LEASE_S


def test_a_neighbour_that_is_frozen_is_kept() -> None:
    assert json.loads(_config([]).get_json("transport/link/tx/lease")) == LEASE_S * 1000
