"""Missions and parameters over a client link that drops 5 % of the frames and corrupts 2 %, both ways."""

from __future__ import annotations

import asyncio
import contextlib

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from aps.vehicle.missions.items import MissionItem
from aps.wire.framer import Framer
from tests.interop.builtin_vehicles import SYSID

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]

COUNT = 200


class LossyClient:
    """A ground station of pymavlink on the daemon's port, with such a link."""

    def __init__(self, reader, writer, sysid, seed):
        self._reader, self._writer = reader, writer
        self._mav = mavlink.MAVLink(None, srcSystem=sysid, srcComponent=190)
        self._mav.robust_parsing = True
        self._framer = Framer()
        self._draws = np.random.default_rng(seed)
        self._heard = []
        self.lost = self.corrupted = 0

    def _carried(self, raw):
        draw = self._draws.random()
        if draw < 0.05:
            self.lost += 1
            return b""
        if draw < 0.07:
            self.corrupted += 1
            at = int(self._draws.integers(len(raw)))
            return raw[:at] + bytes([raw[at] ^ 0x40]) + raw[at + 1 :]
        return raw

    def send(self, message):
        self._writer.write(self._carried(bytes(message.pack(self._mav))))
        self._mav.seq = (self._mav.seq + 1) % 256

    async def next(self, kinds, timeout_s=0.3):
        """The next message of some types, or ``None`` after a while."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(timeout_s):
                while True:
                    while self._heard:
                        message = self._heard.pop(0)
                        if message.get_type() in kinds:
                            return message
                    data = await self._reader.read(65536)
                    for frame in self._framer.receive(data):
                        self._heard += self._mav.parse_buffer(self._carried(frame.raw)) or []
        return None

    async def upload(self, messages):
        """As a ground station does it: repeat what was said last until the autopilot goes on."""
        said = mavlink.MAVLink_mission_count_message(SYSID, 1, len(messages), 0)
        for _ in range(5000):
            self.send(said)
            answer = await self.next(("MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_ACK"))
            if answer is not None and answer.get_type() == "MISSION_ACK":
                if answer.type == mavlink.MAV_MISSION_ERROR and said is messages[-1]:
                    return (
                        mavlink.MAV_MISSION_ACCEPTED
                    )  # it expects no more items: its acknowledgement was lost
                if answer.type != mavlink.MAV_MISSION_INVALID_SEQUENCE:
                    return answer.type
            elif answer is not None:
                said = messages[answer.seq]
        raise AssertionError("no end")

    async def parameters(self):
        """Ask for the list, then for what is missing of it, some at a time."""
        self.send(mavlink.MAVLink_param_request_list_message(SYSID, 1))
        values, missing = {}, None
        while missing is None or missing:
            message = await self.next(("PARAM_VALUE",))
            if message is not None and message.param_index < message.param_count:
                missing = set(range(message.param_count)) if missing is None else missing
                missing.discard(message.param_index)
                values[message.param_id] = message.param_value
            elif message is None and missing is None:
                self.send(mavlink.MAVLink_param_request_list_message(SYSID, 1))
            elif message is None:
                for index in sorted(missing)[:20]:
                    self.send(mavlink.MAVLink_param_request_read_message(SYSID, 1, b"", index))
        return values

    async def download(self):
        said, items, count = mavlink.MAVLink_mission_request_list_message(SYSID, 1, 0), [], None
        while count is None or len(items) < count:
            self.send(said)
            answer = await self.next(("MISSION_COUNT", "MISSION_ITEM_INT"))
            if answer is not None and answer.get_type() == "MISSION_COUNT":
                count = answer.count
            elif answer is not None and count is not None and answer.seq == len(items):
                items.append(answer)
            if count is not None:
                said = mavlink.MAVLink_mission_request_int_message(SYSID, 1, len(items), 0)
        return items


@pytest.fixture
async def connect(served):
    """Call with a seed: a client on the vehicle's daemon."""
    writers = []

    async def connect(seed):
        reader, writer = await asyncio.open_connection("127.0.0.1", served.port)
        writers.append(writer)
        return LossyClient(reader, writer, 255 - seed, seed)

    yield connect
    for writer in writers:
        writer.transport.abort()


def waypoints(state, count):
    """Home, and waypoints of which no two are the same."""
    places = [(state.lat_deg, state.lon_deg, 0.0)]
    places += [
        (state.lat_deg + 1e-5 * number, state.lon_deg - 2e-5 * number, 20.0 + number)
        for number in range(1, count)
    ]
    return [
        MissionItem(16, (0.0, 0.0, 0.0, 0.0, round(lat, 7), round(lon, 7), height))
        for lat, lon, height in places
    ]


async def test_a_mission_of_200_items_up_and_down_and_a_second_client_is_denied(served, connect):
    items = waypoints(served.daemon.state, COUNT)
    messages = [item.to_message(SYSID, seq, 0, current=seq == 0) for seq, item in enumerate(items)]
    first, second = await connect(0), await connect(1)
    asked = asyncio.Event()

    def tap(raw, link):
        if int.from_bytes(raw[7:10], "little") == mavlink.MAVLINK_MSG_ID_MISSION_REQUEST:
            asked.set()

    served.daemon.hub.taps.append(tap)
    uploading = asyncio.create_task(first.upload(messages))
    await asyncio.wait_for(asked.wait(), 60)
    denied = None
    while denied is None:
        assert not uploading.done()
        second.send(mavlink.MAVLink_mission_count_message(SYSID, 1, 3, 0))
        denied = await second.next(("MISSION_ACK",))
    assert denied.type == mavlink.MAV_MISSION_DENIED
    refused = await served.daemon.commands.run("mission_upload", items[:3])
    assert refused.reason == "DENIED (another transfer is under way)"
    assert await uploading == mavlink.MAV_MISSION_ACCEPTED
    kept = await first.download()
    assert [(m.seq, m.command, m.frame, m.x, m.y, m.z) for m in kept[1:]] == [
        (m.seq, m.command, m.frame, m.x, m.y, m.z) for m in messages[1:]
    ]
    assert len(kept) == COUNT
    assert first.lost > 20
    assert first.corrupted > 5
    assert len((await served.daemon.commands.run("mission_download")).value) == COUNT - 1


async def test_all_parameters_come(served, connect):
    everything = (await served.daemon.commands.run("parameters")).value
    client = await connect(2)
    values = await asyncio.wait_for(client.parameters(), 200)
    changing = {name for name in everything if name.startswith("STAT_") or name.endswith("_GND_PRESS")}
    assert values.keys() == everything.keys()
    assert {k: v for k, v in values.items() if k not in changing} == {
        k: v for k, v in everything.items() if k not in changing
    }
    assert len(values) >= (21 if served.kind == "standin" else 1000)
    assert client.lost + client.corrupted > len(values) // 50
