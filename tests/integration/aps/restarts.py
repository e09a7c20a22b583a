"""An autopilot that is killed and started again and again, under three clients of its daemon."""

import asyncio
import contextlib
import itertools
import statistics
import time

from pymavlink.dialects.v20 import ardupilotmega as mavlink

RECONNECT_S = 3.0
ATTITUDE, VFR_HUD = 30, 74
ATTITUDE_HZ, VFR_HUD_HZ = 50, 25


class Watcher:
    """A client that stays: it reads all the time, and keeps what came lately."""

    def __init__(self, client):
        self.client = client
        self.dropped = False
        self.messages = []
        self._more = asyncio.Event()
        self._task = asyncio.create_task(self._read())

    async def _read(self):
        with contextlib.suppress(ConnectionError):
            while data := await self.client.reader.read(65536):
                self.messages += self.client.mav.parse_buffer(data) or []
                self._more.set()
        self.dropped = True
        self._more.set()

    def ask(self, sysid, msg_id, rate_hz):
        self.client.send(
            mavlink.MAVLink_command_long_message(sysid, 1, 511, 0, msg_id, 1e6 / rate_hz, 0, 0, 0, 0, 0)
        )

    async def until(self, condition):
        """Wait until what has come since satisfies a condition."""
        self.messages.clear()
        while not condition(self.messages) and not self.dropped:
            self._more.clear()
            await self._more.wait()
            del self.messages[:-2000]

    def stop(self):
        self._task.cancel()


def has_attitude_at_its_rate(messages):
    """Whether the latest steps of its own clock are those that were asked for."""
    times_ms = [message.time_boot_ms for message in messages if message.get_type() == "ATTITUDE"][-26:]
    steps_ms = [later - earlier for earlier, later in itertools.pairwise(times_ms)]
    return len(steps_ms) == 25 and statistics.mean(steps_ms) < 1.2 * 1000 / ATTITUDE_HZ


def has_vfr_hud_at_its_rate(messages):
    """Whether lately there was one for every two of the other."""
    kinds = [message.get_type() for message in messages if message.get_type() in ("ATTITUDE", "VFR_HUD")][
        -75:
    ]
    return len(kinds) == 75 and kinds.count("VFR_HUD") >= 20


async def survives_restarts(daemon, connect, start, kill, times=10):
    """Ten times: killed, started, heard again in time, with all intervals; returns the times that it took, s.

    ``start`` returns when the autopilot can be connected to, ``kill`` when it is gone.
    """
    await asyncio.wait_for(daemon.wait_heard(), 60)
    watchers = [Watcher(await connect(daemon.listen_port, sysid)) for sysid in (255, 254, 253)]
    try:
        watchers[0].ask(daemon.config.sysid, ATTITUDE, ATTITUDE_HZ)
        watchers[1].ask(daemon.config.sysid, VFR_HUD, VFR_HUD_HZ)
        await _all_have_their_rates(watchers)
        return [await _once(daemon, watchers, start, kill, number) for number in range(times)]
    finally:
        for watcher in watchers:
            watcher.stop()


async def _once(daemon, watchers, start, kill, number):
    links = set(daemon.links.clients)
    assert len(links) == len(watchers)
    connections = daemon.connections
    await kill()
    async with asyncio.timeout(5):
        while daemon.link_up:  # noqa: ASYNC110 (the daemon has no event for the end of a connection)
            await asyncio.sleep(0.001)
    before = daemon.state
    async with asyncio.timeout(30):  # what was heard last stays, and it is shown how old that is
        while (  # noqa: ASYNC110 (time passes without an event)
            daemon.state.age_s("roll_rad") < before.age_s("roll_rad") + 0.2
            or daemon.state.heartbeat_age_s < before.heartbeat_age_s + 0.2
        ):
            await asyncio.sleep(0.001)
    stale = daemon.state
    assert not daemon.link_up
    assert stale.roll_rad == before.roll_rad
    await start()
    begin_s = time.monotonic()
    await asyncio.wait_for(daemon.wait_heard(), 30)
    took_s = time.monotonic() - begin_s
    assert daemon.connections == connections + 1
    await _all_have_their_rates(watchers)
    assert set(daemon.links.clients) == links
    assert not any(watcher.dropped for watcher in watchers), number
    assert daemon.state.age_s("roll_rad") < 1.0
    return took_s


async def _all_have_their_rates(watchers):
    async with asyncio.timeout(60):
        await asyncio.gather(
            *(watcher.until(has_attitude_at_its_rate) for watcher in watchers),
        )
        await asyncio.gather(*(watcher.until(has_vfr_hud_at_its_rate) for watcher in watchers))
