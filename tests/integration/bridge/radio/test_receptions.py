"""What a receiver is told of each packet, on board and beside the run, is what the record says of it."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from bridge.agents import Reception, connect_ua
from tests.integration.bridge.conftest import STILL, StartRun

LISTENER = """\
from bridge.agents import Agent

class Listener(Agent):
    def on_packet(self, sender, channel, payload, reception):
        super().on_packet(sender, channel, payload, reception)
        self.record("heard", sender=sender, seq=reception.seq, sent_ns=reception.sim_time_ns,
                    rssi_dbm=reception.rssi_dbm, snr_db=reception.snr_db, age_s=reception.age_s,
                    attitude_age_s=self.ua.age_s("euler_rad"))
        if self.options.get("raw") and reception.seq % 10 == 0:
            self.ua.transmit("team", b"no data package")
            self.ua.transmit("chatter", b"neither, but nobody expects one here")
"""
PROBE = "  - {{id: probe, kind: ground, place: {{north_m: 50}}, agent: {{type: free}}}}\n"


@pytest.mark.parametrize("processes", ["one", pytest.param("many", marks=pytest.mark.slow)])
def test_power_snr_number_and_age_of_each_packet(start_run: StartRun, tmp_path: Path, processes: str) -> None:
    (tmp_path / "listener.py").write_text(LISTENER)
    own = f"{{{{type: own, class: {tmp_path}/listener.py:Listener, options: {{{{raw: true}}}}, has_task: false}}}}"
    first, _, rest = STILL.rpartition("{{type: still}}")
    scenario = (first + own + rest).replace("moon2020", "corrected") + PROBE
    run = start_run(scenario=scenario, duration_s=16.0, speed="4", processes=processes)
    run.wait_for("sim time")
    beside: list[tuple[str, Reception]] = []
    like_agent: list[tuple[int, str, Reception]] = []
    states: list[tuple[int, int]] = []

    async def listen() -> None:
        async with connect_ua(run.directory, "probe") as probe, connect_ua(run.directory, "1") as one:
            enough = asyncio.Event()

            def heard(sender: str, _channel: str, _payload: bytes, reception: Reception) -> None:
                beside.append((sender, reception))
                if len(beside) >= 30 and len(like_agent) > 10 and len(states) > 20:
                    enough.set()

            probe.on_packet(heard)
            one.on_packet(
                lambda sender, _channel, _payload, told: like_agent.append((one.sim_time_ns, sender, told))
            )

            def ticked(now_ns: int) -> None:
                if one.state is not None:  # it knows where it is
                    states.append((now_ns, one.state.header.stamp.ns))

            one.on_tick(ticked)
            await asyncio.wait_for(enough.wait(), 30.0)

    asyncio.run(listen())
    assert run.finish() == 0, run.output.decode()
    table = pq.read_table(run.directory / "deliveries.parquet").to_pylist()
    rows = {(row["rx"], row["tx"], row["seq"]): row for row in table if row["fate"] == "delivered"}
    on_board = [
        json.loads(line) for line in (run.directory / "agents/1/heard.jsonl").read_text().splitlines()
    ]
    assert len(on_board) > 100
    for told in on_board:
        row = rows["1", told["sender"], told["seq"]]
        assert told["rssi_dbm"] == pytest.approx(row["received_power_dbm"], abs=1e-4)
        assert told["snr_db"] == pytest.approx(row["snr_db"], abs=1e-4)
        assert (told["sent_ns"], told["age_s"]) == (row["sim_time_ns"], 0.05)
    counters = run.summary["counters"]["router"]
    raw = sum(told["seq"] % 10 == 0 for told in on_board)
    assert {name: count for name, count in counters.items() if "package" in name} == {
        "no_data_package_on_the_data_channel.1": raw
    }
    assert [told["attitude_age_s"] <= 0.1 for told in on_board[-20:]] == [True] * 20
    powers = [told["rssi_dbm"] for told in on_board]
    assert max(powers) - min(powers) > 6.0  # nobody moves: this is the packets' own shadowing
    for sender, reception in beside[:30]:
        row = rows["probe", sender, reception.seq]
        assert reception.rssi_dbm == pytest.approx(row["received_power_dbm"], abs=1e-4)
        assert reception.snr_db == pytest.approx(row["snr_db"], abs=1e-4)
        assert reception.sim_time_ns == row["sim_time_ns"]
        assert reception.age_s in (0.05, 0.1, 0.15)  # the clock does not wait for it
    # as on board: a packet comes a tick after it was transmitted
    assert sorted(reception.age_s for _, reception in beside[:30])[15] == 0.05
    # A script beside node 1 gets what the agent of node 1 got, in the same order and at the same ticks.
    as_on_board = [(told["sim_time_s"], told["sender"], told["seq"], told["age_s"]) for told in on_board]
    as_beside = [(now_ns / 1e9, sender, told.seq, told.age_s) for now_ns, sender, told in like_agent]
    first = as_on_board.index(as_beside[0])
    assert len(as_beside) > 10
    assert as_beside == as_on_board[first : first + len(as_beside)]
    published = [(now_ns, state_ns) for now_ns, state_ns in states[3:] if now_ns % 100_000_000 == 0]
    assert len(published) > 5
    assert all(now_ns == state_ns for now_ns, state_ns in published)
