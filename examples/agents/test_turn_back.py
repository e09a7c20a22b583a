"""A test of one's own algorithm, on a whole flight: `pytest examples/agents/test_turn_back.py`.

It needs pytest-asyncio; and in a checkout, whose settings of pytest ask for more, what `make .venv/.dev` installs.
"""

from pathlib import Path

SCENARIO = Path(__file__).with_name("turn_back.yaml")


async def test_it_turns_back_where_the_link_breaks(fleet):
    flight = await fleet(SCENARIO, seed=3)
    out_s = await flight.ua(1).at(north_m=200, within_m=10)
    await flight.ua(1).at(north_m=100, within_m=10, after_s=out_s)
    assert flight.link(0, 1).delivery(max_m=150) > 0.9
