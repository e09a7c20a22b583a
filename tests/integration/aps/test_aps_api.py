"""The API over a real socket: a real daemon behind it, and a scripted autopilot behind that."""

import asyncio
import contextlib
import http.client
import json
import socket

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from websockets.asyncio.client import connect as open_stream
from websockets.exceptions import ConnectionClosed, InvalidStatus

from aps.api.backend import DaemonBackend
from aps.api.guard import ApiConfig
from aps.api.server import ApiServer
from aps.daemon import Daemon, DaemonConfig
from aps.vehicle.commander import VERBS, argument_names
from tests.integration.aps.conftest import ScriptedAutopilot

TOKEN = "0123456789abcdef-token"


class Keeping(ScriptedAutopilot):
    """A scripted autopilot with a mission protocol and two parameters."""

    def __init__(self):
        super().__init__()
        self.items = {0: [], 1: [], 2: []}
        self.parameters = {"RTL_ALT": 1500.0, "WPNAV_SPEED": 500.0}
        self._receiving = (0, 0, [])

    def _handle(self, message):
        super()._handle(message)
        handler = getattr(self, "on_" + message.get_type().lower(), None)
        if handler is not None:
            handler(message, (message.get_srcSystem(), message.get_srcComponent()))

    def on_mission_count(self, message, who):
        self._receiving = (message.mission_type, message.count, [])
        self._ask(who)

    def on_mission_item_int(self, message, who):
        self._receiving[2].append(message)
        self._ask(who)

    def _ask(self, who):
        kind, count, items = self._receiving
        if len(items) < count:
            self.send(mavlink.MAVLink_mission_request_int_message(*who, len(items), kind))
        else:
            self.items[kind] = items
            self.send(mavlink.MAVLink_mission_ack_message(*who, 0, kind))

    def on_mission_request_list(self, message, who):
        count = len(self.items[message.mission_type])
        self.send(mavlink.MAVLink_mission_count_message(*who, count, message.mission_type))

    def on_mission_request_int(self, message, who):
        kept = self.items[message.mission_type][message.seq]
        values = [getattr(kept, name) for name in kept.fieldnames]
        self.send(mavlink.MAVLink_mission_item_int_message(*who, *values[2:]))

    def on_param_request_read(self, message, who):
        self._tell(message.param_id, 65535)

    def on_param_set(self, message, who):
        self.parameters[message.param_id] = message.param_value
        self._tell(message.param_id, 65535)

    def on_param_request_list(self, message, who):
        for index, name in enumerate(self.parameters):
            self._tell(name, index)

    def _tell(self, name, index):
        if name in self.parameters:
            value = self.parameters[name]
            self.send(
                mavlink.MAVLink_param_value_message(name.encode(), value, 9, len(self.parameters), index)
            )


@pytest.fixture
async def keeping():
    autopilot = Keeping()
    await autopilot.start()
    yield autopilot
    await autopilot.stop()


@pytest.fixture
async def daemon(keeping, eventually):
    config = DaemonConfig(autopilot=f"tcp:127.0.0.1:{keeping.port}", sysid=2)
    async with Daemon(config) as daemon:
        await eventually(lambda: daemon.state.ready_to_arm and daemon.state.position_ned_m)
        daemon.commands.ftp = False
        yield daemon


class Caller:
    """Calls the API as any HTTP client would."""

    def __init__(self, port):
        self.port = port

    async def __call__(self, method, path, body=None, **headers):
        data = body if body is None or isinstance(body, bytes) else json.dumps(body).encode()
        return await asyncio.to_thread(self._call, method, path, data, headers)

    def _call(self, method, path, data, headers):
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=20)
        with contextlib.closing(connection):
            kind = {"Content-Type": "application/json"} if data else {}
            connection.request(
                method, path, data, kind | {name.replace("_", "-"): text for name, text in headers.items()}
            )
            reply = connection.getresponse()
            text = reply.read().decode()
            is_json = reply.headers.get_content_type() == "application/json"
            return reply.status, json.loads(text) if is_json else text


@pytest.fixture
async def call(daemon):
    async with ApiServer(DaemonBackend(daemon), ApiConfig()) as server:
        caller = Caller(server.port)
        caller.server = server
        yield caller


async def test_state_messages_and_statistics(call, keeping):
    status, state = await call("GET", "/state")
    assert (status, state["mode"], state["armed"], state["connected"]) == (200, "STABILIZE", False, True)
    assert state["lat_deg"] == pytest.approx(47.0)
    assert 0.0 <= state["age_s"]["lat_deg"] < 5.0
    assert state["wind_ned_mps"] == [None, None, None]
    assert state["age_s"]["wind_ned_mps"] is None
    status, names = await call("GET", "/messages")
    assert {"HEARTBEAT", "ATTITUDE"} <= set(names)
    status, last = await call("GET", "/messages/attitude")
    assert (status, last["name"], last["fields"]["roll"]) == (200, "ATTITUDE", pytest.approx(0.1))
    assert (await call("GET", "/messages/NOTHING"))[0] == 404
    status, never = await call("GET", "/messages/WIND")
    assert (status, "no WIND has come" in never["detail"]) == (404, True)
    status, statistics = await call("GET", "/statistics")
    assert (status, statistics["autopilot"]["connections"]) == (200, 1)


async def test_commands_to_their_result(call, keeping, daemon):
    keeping.refuse[400] = (4, "Arm: Gyros inconsistent")
    status, result = await call("POST", "/commands/arm")
    assert (status, result["outcome"], result["reason"]) == (
        409,
        "refused",
        "FAILED: Arm: Gyros inconsistent",
    )
    del keeping.refuse[400]
    for verb, arguments in (("mode", {"mode": "GUIDED"}), ("arm", {}), ("takeoff", {"alt_rel_m": 10})):
        status, result = await call("POST", f"/commands/{verb}", arguments)
        assert (status, result["outcome"]) == (200, "reached"), result
    assert daemon.state.alt_rel_m > 9.0
    status, again = await call("POST", "/commands/takeoff", {"alt_rel_m": 900})
    assert (status, again["outcome"], again["reason"]) == (409, "refused", "it flies already")
    far = {"lat_deg": 48.0, "lon_deg": 8.0, "alt_rel_m": 20}
    status, started = await call("POST", "/commands/goto?wait=false", far)
    assert (status, started["verb"], started["result"]) == (202, "goto", None)
    status, landed = await call("POST", "/commands/land")
    assert landed["outcome"] == "reached"
    status, ended = await call("GET", f"/commands/{started['id']}")
    assert ended["result"]["reason"] == "by land"
    assert [job["verb"] for job in (await call("GET", "/commands"))[1]][-2:] == ["goto", "land"]
    assert (await call("GET", "/commands/999"))[0] == 404


async def test_wrong_arguments_are_named(call):
    for verb, arguments, says in (
        ("goto", {"lat_deg": 147, "lon_deg": 8, "alt_rel_m": 5}, "lat_deg must be in -90..90"),
        ("goto", {"lat_deg": 47}, "lon_deg"),
        ("goto", {"lat_deg": 47, "lon_deg": 8, "alt_rel_m": 5, "fast": 1}, "fast"),
        ("mode", {"mode": "SWIM"}, "'SWIM' is none of"),
        ("mission_upload", {"items": [{"command": 16}]}, "item 0"),
        ("send", {"name": "WIND", "fields": {"power": 1}}, "no field 'power'"),
    ):
        status, reply = await call("POST", f"/commands/{verb}", arguments)
        assert status == 422
        assert says in json.dumps(reply)


async def test_a_command_that_there_is_not_is_answered_with_those_that_there_are(call):
    status, reply = await call("POST", "/commands/fly", {})
    assert status == 404
    assert "no command 'fly'; there are arm, " in reply["detail"]


PLAN = {
    "fileType": "Plan",
    "mission": {
        "items": [
            {
                "type": "SimpleItem",
                "command": 16,
                "frame": 3,
                "params": [0, 0, 0, None, 47 + n / 1000, 8, 20],
                "autoContinue": True,
            }
            for n in range(25)
        ]
    },
    "geoFence": {"circles": [{"circle": {"center": [47, 8], "radius": 100}, "inclusion": True}]},
    "rallyPoints": {"points": [[47.5, 8.5, 30]]},
}


@pytest.mark.parametrize(
    ("verb", "arguments", "at"),
    [
        ("parameter_set", {"name": "RTL_ALT", "value": True}, ["body", "value"]),
        ("parameter_set", {"name": "RTL_ALT", "value": "1600"}, ["body", "value"]),
        ("parameters_set", {"values": {"RTL_ALT": False}}, ["body", "values", "RTL_ALT"]),
        ("mission_set_current", {"seq": True}, ["body", "seq"]),
        ("disarm", {"force": "no"}, ["body", "force"]),
    ],
)
async def test_what_is_no_number_is_not_taken_for_one(call, keeping, verb, arguments, at):
    status, reply = await call("POST", f"/commands/{verb}", arguments)
    assert (status, [one["loc"] for one in reply["detail"]]) == (422, [at])
    assert keeping.parameters["RTL_ALT"] == 1500.0


async def test_plans_and_waypoint_files_up_and_down(call, keeping):
    status, reply = await call("PUT", "/plan", PLAN)
    assert (status, reply) == (200, {"mission": 25, "fence": 1, "rally": 1})
    assert [len(items) for items in keeping.items.values()] == [26, 1, 1]
    status, plan = await call("GET", "/plan")
    assert [item["params"] for item in plan["mission"]["items"]] == [
        pytest.approx(item["params"]) if None not in item["params"] else item["params"]
        for item in PLAN["mission"]["items"]
    ]
    assert plan["geoFence"]["circles"][0]["circle"] == {"center": [47, 8], "radius": 100}
    assert plan["rallyPoints"]["points"] == [[47.5, 8.5, 30]]
    status, text = await call("GET", "/waypoints")
    assert len(text.splitlines()) == 27
    status, reply = await call("PUT", "/waypoints", text.encode())
    assert (status, reply) == (200, {"mission": 25})
    status, reply = await call("PUT", "/waypoints", b"QGC WPL 110\nnonsense")
    assert (status, reply["detail"]) == (422, "line 2: 12 columns are expected, not 1")


@pytest.mark.parametrize(("kind", "target"), [(3, 2), (12, 1)])
async def test_jumps_in_files_count_home_whatever_the_autopilot_does(
    call, keeping, daemon, eventually, kind, target
):
    """As in QGroundControl (PlanManager::writeMissionItems): PX4, which has no home in its missions, gets one less."""
    keeping.kind = kind
    await eventually(lambda: daemon.state.autopilot == kind)
    jump = {"type": "SimpleItem", "command": 177, "frame": 2, "params": [2, 3, 0, 0, 0, 0, 0], "doJumpId": 3}
    plan = {"fileType": "Plan", "mission": {"items": [*PLAN["mission"]["items"][:2], jump]}}
    status, reply = await call("PUT", "/plan", plan)
    assert (status, reply["mission"], keeping.items[0][-1].param1) == (200, 3, target)
    _, plan = await call("GET", "/plan")
    assert plan["mission"]["items"][-1]["params"][:2] == [2, 3]
    _, text = await call("GET", "/waypoints")
    assert float(text.splitlines()[-1].split()[4]) == 2.0
    keeping.items[0] = []
    assert await call("PUT", "/waypoints", text.encode()) == (200, {"mission": 3})
    assert keeping.items[0][-1].param1 == target


async def test_places_that_are_not_given_in_files(call, keeping):
    """The autopilot keeps what others gave it: null in a plan's mission, and no fence or rally point of one."""

    def nowhere(command, kind):
        head = (1, 1, int(kind == 0), 3, command, 0, 1, 0, 0, 0, 0)
        return mavlink.MAVLink_mission_item_int_message(*head, 2**31 - 1, 2**31 - 1, 20, kind)

    await call("PUT", "/plan", PLAN)
    keeping.items[0][1] = nowhere(21, 0)
    status, plan = await call("GET", "/plan")
    assert (status, plan["mission"]["items"][0]["params"][4:]) == (200, [None, None, 20])
    status, text = await call("GET", "/waypoints")
    assert (status, text.splitlines()[2].split()[8:10]) == (200, ["0.00000000", "0.00000000"])
    keeping.items[2][0] = nowhere(5100, 2)
    status, reply = await call("GET", "/plan")
    assert (status, reply["detail"][:45]) == (409, "a rally point has 3 numbers that are finite, ")


async def test_parameters_as_files(call, keeping):
    _, text = await call("GET", "/parameters")
    assert text.split() == ["RTL_ALT", "1500", "WPNAV_SPEED", "500"]
    _, differences = await call("POST", "/parameters/compare", b"RTL_ALT 1500\nWPNAV_SPEED 600\nNEW 1\n")
    assert differences == [
        {"name": "NEW", "file": 1.0, "autopilot": None},
        {"name": "WPNAV_SPEED", "file": 600.0, "autopilot": 500.0},
    ]
    assert (await call("PUT", "/parameters", b"RTL_ALT,2000\n"))[1] == {"set": 1}
    assert keeping.parameters["RTL_ALT"] == 2000.0


async def test_the_stream_tells_states_messages_texts_progress_and_results(call, keeping):
    address = f"ws://127.0.0.1:{call.server.port}/stream?rate_hz=20&messages=ATTITUDE"
    async with open_stream(address) as stream, asyncio.timeout(20):
        keeping.send(mavlink.MAVLink_statustext_message(4, b"Low battery"))
        running = asyncio.create_task(call("POST", "/commands/mode", {"mode": "GUIDED"}))
        seen = {}
        while not {"state", "message", "text", "progress", "result"} <= seen.keys():
            event = json.loads(await stream.recv())
            seen.setdefault(event["type"], event)
        await running
    assert seen["state"]["lat_deg"] == pytest.approx(47.0)
    assert seen["message"]["name"] == "ATTITUDE"
    assert (seen["text"]["text"], seen["text"]["severity"]) == ("Low battery", 4)
    assert (seen["progress"]["phase"], seen["progress"]["verb"]) == ("accepted", "mode")
    assert seen["result"]["outcome"] == "reached"


@pytest.mark.slow
async def test_a_listener_that_does_not_read_holds_up_nobody(call, daemon, eventually):
    address = f"ws://127.0.0.1:{call.server.port}/stream?rate_hz=50&messages=HEARTBEAT,ATTITUDE,SYS_STATUS"
    async with open_stream(address, max_queue=1) as stalled, open_stream(address) as reader:
        stalled.transport.pause_reading()
        before = daemon.state.time_boot_ms
        last = 0
        async with asyncio.timeout(30):
            while last < before + 20_000:
                event = json.loads(await reader.recv())
                last = event.get("time_boot_ms", last)
        assert (await call("GET", "/state"))[0] == 200
        stalled.transport.resume_reading()


async def test_a_message_that_does_not_exist_closes_the_stream(call):
    async with open_stream(f"ws://127.0.0.1:{call.server.port}/stream?messages=NOTHING") as stream:
        with pytest.raises(ConnectionClosed, match="no MAVLink message"):
            await stream.recv()


async def test_every_command_is_described_with_its_arguments(call):
    status, api = await call("GET", "/openapi.json")
    schemas = api["components"]["schemas"]
    for verb in VERBS:
        body = api["paths"][f"/commands/{verb}"]["post"]["requestBody"]
        model = body["content"]["application/json"]["schema"]
        name = model.get("$ref", "").rsplit("/", 1)[-1] or verb
        properties = schemas.get(name, model).get("properties", {})
        assert tuple(properties) == argument_names(verb), verb
    status, page = await call("GET", "/")
    assert (status, "openapi.json" in page) == (200, True)
    assert "https://" not in page  # it works without a network


async def test_pages_of_other_sites_are_refused(call):
    for headers, status, reason in (
        ({"Host": "evil.example"}, 421, "host"),
        ({"Host": "evil.example:8760"}, 421, "host"),
        ({"Origin": "http://evil.example"}, 403, "origin"),
        ({"Origin": "null"}, 403, "origin"),
        ({"Sec_Fetch_Site": "cross-site"}, 403, "origin"),
        ({"Content_Length": "99999999"}, 413, "size"),
    ):
        call.server.refused.clear()
        assert (await call("POST", "/commands/arm", **headers))[0] == status
        assert call.server.refused == {reason: 1}
    for host in ("localhost:1", "[::1]:1", "192.168.1.7"):
        assert (await call("GET", "/state", Host=host))[0] == 200


async def test_a_stream_of_another_site_is_refused(call):
    address = f"ws://127.0.0.1:{call.server.port}/stream"
    with pytest.raises(InvalidStatus, match="403"):
        async with open_stream(address, origin="http://evil.example"):
            pass
    async with open_stream(address, origin=f"http://127.0.0.1:{call.server.port}") as stream:
        assert await asyncio.wait_for(stream.recv(), 10)


async def test_with_a_token_nothing_goes_without(daemon):
    config = ApiConfig(token=TOKEN, hosts=("ua.example",), origins=("https://gcs.example",))
    async with ApiServer(DaemonBackend(daemon), config) as server:
        call = Caller(server.port)
        assert (await call("GET", "/state"))[0] == 401
        assert (await call("GET", "/state", Authorization="Bearer " + TOKEN[:-1]))[0] == 401
        assert (await call("GET", "/state", Authorization="Bearer \u00fc"))[0] == 401
        good = {"Authorization": f"Bearer {TOKEN}"}
        assert (await call("GET", "/state", **good))[0] == 200
        assert (await call("GET", "/state", Host="ua.example", **good))[0] == 200
        assert (await call("GET", "/state", Origin="https://gcs.example", **good))[0] == 200
        address = f"ws://127.0.0.1:{server.port}/stream"
        with pytest.raises(InvalidStatus):
            async with open_stream(address):
                pass
        async with open_stream(f"{address}?token={TOKEN}") as stream:
            assert await asyncio.wait_for(stream.recv(), 10)


def test_beyond_this_machine_it_needs_a_token():
    with pytest.raises(ValueError, match="it needs a token"):
        ApiConfig(host="0.0.0.0")
    with pytest.raises(ValueError, match="at least 16"):
        ApiConfig(host="0.0.0.0", token="short")
    assert ApiConfig(host="0.0.0.0", token=TOKEN).token == TOKEN


async def test_a_port_in_use_is_an_error_at_once(daemon, call):
    with pytest.raises(OSError, match="in use"):
        async with ApiServer(DaemonBackend(daemon), ApiConfig(port=call.server.port)):
            pass


async def test_garbage_on_the_port_is_no_end_of_it(call):
    for data in (
        b"\x00" * 5000,
        b"GET / HTTP/1.1\r\n" + b"A: b\r\n" * 5000,
        b"POST /commands/arm HTTP/9\r\n\r\n",
    ):
        reader, writer = await asyncio.open_connection("127.0.0.1", call.server.port)
        writer.write(data)
        with contextlib.suppress(ConnectionError):
            await writer.drain()
            writer.write_eof()
            await asyncio.wait_for(reader.read(), 10)
        writer.close()
    assert (await call("GET", "/state"))[0] == 200


async def test_links_are_opened_and_ended_while_the_daemon_runs(call, daemon, make_udp_peer, eventually):
    peer = await make_udp_peer()
    status, opened = await call("POST", "/links", {"address": f"udp-out:127.0.0.1:{peer.port},max-hz=30:5"})
    assert (status, opened["place"]) == (201, 1)
    await peer.next("ATTITUDE")
    status, told = await call("GET", "/links")
    assert {"place": 1, "address": f"udp-out:127.0.0.1:{peer.port}"} in told["places"]
    assert {"place": None, "address": "tcp-server:127.0.0.1:0"} in told["places"]
    roles = [link["role"] for link in told["links"]]
    assert roles == ["autopilot", "client"]
    assert told["links"][0]["latency"]["asked"] > 0
    assert (await call("DELETE", "/links/1"))[0] == 204
    assert daemon.links.clients == {}
    assert (await call("DELETE", "/links/1"))[0] == 404
    status, opened = await call("POST", "/links", {"address": "tcp-server::0"})
    assert (status, opened["place"]) == (201, 2)
    taken = call.server.port
    assert (await call("POST", "/links", {"address": f"tcp-server:127.0.0.1:{taken}"}))[0] == 409
    for wrong in ("udp-out:nowhere", "smoke:1", "udp-out:127.0.0.1:1,max-hz=x"):
        assert (await call("POST", "/links", {"address": wrong}))[0] == 422


async def test_without_a_token_no_links_beyond_this_machine_are_opened(call, daemon, tmp_path):
    (tmp_path / "key").write_text("secret")
    for address in (
        "udp-out:192.0.2.7:14550",
        "tcp-server:0.0.0.0:0",
        "tcp:gcs.example:5760",
        "serial:/dev/ttyACM0:57600",
        f"udp-out:127.0.0.1:9,key={tmp_path}/key",
    ):
        status, reply = await call("POST", "/links", {"address": address})
        assert (status, "beyond this machine" in reply["detail"]) == (403, True), address
    assert daemon.opened == {}
    config = ApiConfig(token=TOKEN)
    async with ApiServer(DaemonBackend(daemon), config) as server:
        guarded = Caller(server.port)
        wish = {"address": "udp-in:0.0.0.0:0"}
        assert (await guarded("POST", "/links", wish))[0] == 401
        assert (await guarded("POST", "/links", wish, Authorization=f"Bearer {TOKEN}"))[0] == 201


async def test_links_that_cannot_be_opened_for_good_end_alone(call, daemon, eventually, monkeypatch):
    def refused(*_: object, **__: object) -> None:
        raise UnicodeError("a resolver that chokes on the name")

    with monkeypatch.context() as fault:
        fault.setattr(socket, "getaddrinfo", refused)
        await daemon.open("tcp:chokes.example:5760")
        await eventually(lambda: not daemon.opened)
    assert daemon.failure is None
    assert (await call("GET", "/state"))[0] == 200


async def test_too_many_places_are_refused(call, daemon):
    for _ in range(32):
        assert (await call("POST", "/links", {"address": "udp-in::0"}))[0] == 201
    assert (await call("POST", "/links", {"address": "udp-in::0"}))[0] == 409


async def test_the_status_once_and_as_a_stream(call, daemon):
    status, told = await call("GET", "/status")
    assert (status, told["sysid"], told["state"]["mode"]) == (200, 2, "STABILIZE")
    assert told["statistics"]["autopilot_links"][0]["up"]
    async with open_stream(f"ws://127.0.0.1:{call.server.port}/stream?rate_hz=0&status_hz=10") as stream:
        async with asyncio.timeout(10):
            events = [json.loads(await stream.recv()) for _ in range(3)]
    assert {event["type"] for event in events} == {"status"}
    frames = [event["statistics"]["autopilot_links"][0]["frames_in"] for event in events]
    assert frames[0] < frames[-1]


@pytest.mark.parametrize(
    ("kind", "body"),
    [
        ("application/json", b'{"lat_deg": "\\ud800", "lon_deg": 8, "alt_rel_m": 9}'),
        ("application/json", b'{"lat_deg": 47, "lon_deg": 8, "alt_rel_m": 9, "frame": NaN}'),
        ("application/json", b'{"lat_deg": 47, "lon_deg": 8, "alt_rel_m": 9, "\\udc00": 1}'),
        ("text/plain", b"\xff\xfe"),
    ],
)
async def test_what_no_json_can_say_again_is_refused_as_any_mistake(call, kind, body, caplog):
    status, reply = await call("POST", "/commands/goto", body, Content_Type=kind)
    assert status == 422
    assert reply["detail"][0]["loc"][0] == "body"
    assert caplog.text == ""


async def test_a_stream_of_a_message_with_a_long_name_is_told_why_it_ends(call):
    async with open_stream(f"ws://127.0.0.1:{call.port}/stream?messages={'A' * 300}") as stream:
        with pytest.raises(ConnectionClosed) as closed:
            await stream.recv()
    assert closed.value.rcvd.code == 1008
    assert closed.value.rcvd.reason.startswith("there is no MAVLink message 'AAA")


@pytest.mark.parametrize("wrong", ["rate_hz=51", "rate_hz=nan", "status_hz=-1", "status_hz=often"])
async def test_a_stream_with_a_wrong_argument_is_told_which(call, wrong):
    async with open_stream(f"ws://127.0.0.1:{call.port}/stream?{wrong}") as stream:
        with pytest.raises(ConnectionClosed) as closed:
            await stream.recv()
    assert closed.value.rcvd.code == 1008
    assert closed.value.rcvd.reason.startswith(f"{wrong}: Input should be ")


async def test_a_body_of_another_type_is_told_what_is_taken_for_json(call):
    status, reply = await call(
        "POST", "/commands/mode", b'{"mode": "GUIDED"}', Content_Type="application/x-www-form-urlencoded"
    )
    assert status == 422
    assert "Content-Type: application/json" in reply["detail"][0]["msg"]


@pytest.mark.parametrize(
    ("method", "path"),
    [("POST", "/commands/mode"), ("POST", "/links"), ("PUT", "/plan"), ("PUT", "/parameters")],
)
async def test_a_body_without_a_length_is_refused_when_it_is_too_long(
    call, monkeypatch, caplog, method, path
):
    monkeypatch.setattr("aps.api.guard.MAX_BODY_BYTES", 1000)
    reader, writer = await asyncio.open_connection("127.0.0.1", call.port)
    with contextlib.closing(writer):
        head = f"{method} {path} HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
        body = b"3e9\r\n" + b" " * 1001 + b"\r\n0\r\n\r\n"
        writer.write(head.encode() + b"Transfer-Encoding: chunked\r\n\r\n" + body)
        assert (await asyncio.wait_for(reader.readline(), 10)).startswith(b"HTTP/1.1 413 ")
        assert b'{"detail":"refused: size"}' in await asyncio.wait_for(reader.readuntil(b"}"), 10)
    assert call.server.refused == {"size": 1}
    assert caplog.text == ""


async def test_who_hangs_up_within_a_file_is_no_error(call, daemon, caplog, eventually):
    for method, path in (("PUT", "/plan"), ("POST", "/parameters/compare")):
        _, writer = await asyncio.open_connection("127.0.0.1", call.port)
        writer.write(f"{method} {path} HTTP/1.1\r\nHost: localhost\r\nContent-Length: 9\r\n\r\n{{".encode())
        await writer.drain()
        writer.close()
        await writer.wait_closed()
        await call("GET", "/commands")
    assert "Traceback" not in caplog.text


async def test_commands_under_way_when_the_api_ends_are_answered(daemon, caplog):
    async with ApiServer(DaemonBackend(daemon), ApiConfig()) as server:
        call = Caller(server.port)
        asked = asyncio.create_task(call("POST", "/commands/parameter_get", {"name": "NO_SUCH"}))
        while not (await call("GET", "/commands"))[1]:
            pass
    status, reply = await asked
    assert (status, reply["outcome"], reply["reason"]) == (409, "interrupted", "the API ends")
    assert caplog.text == ""


async def test_a_command_whose_body_comes_while_the_api_ends_is_answered(daemon, caplog):
    server = await ApiServer(DaemonBackend(daemon), ApiConfig()).__aenter__()
    reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
    head = "POST /commands/parameter_get HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
    writer.write(f"{head}Content-Length: 19\r\nExpect: 100-continue\r\n\r\n".encode())
    assert (await asyncio.wait_for(reader.readuntil(b"\r\n\r\n"), 10)).startswith(b"HTTP/1.1 100 ")
    end = asyncio.create_task(server.__aexit__())
    await asyncio.sleep(0)  # it has begun to end
    writer.write(b'{"name": "NO_SUCH"}')
    assert (await asyncio.wait_for(reader.readline(), 10)).startswith(b"HTTP/1.1 409 ")
    assert b'"reason":"the API ends"' in await asyncio.wait_for(reader.readuntil(b"}"), 10)
    writer.close()
    await end
    assert caplog.text == ""


async def test_a_stream_as_slow_as_a_number_can_say_has_the_state_once(call):
    async with open_stream(f"ws://127.0.0.1:{call.port}/stream?rate_hz=1e-320") as stream:
        assert json.loads(await asyncio.wait_for(stream.recv(), 10))["type"] == "state"


async def test_a_flood_of_requests_waits(call):
    """Two thousand at once are worked off at their pace; the daemon has the rest of the time."""
    reader, writer = await asyncio.open_connection("127.0.0.1", call.port)
    loop = asyncio.get_running_loop()
    began_s = loop.time()
    writer.write(b"GET /commands HTTP/1.1\r\nHost: localhost\r\n\r\n" * 2000)
    for answered in range(1, 151):
        await asyncio.wait_for(reader.readuntil(b"HTTP/1.1 200"), 10)
        assert answered <= 52 + 100 * (loop.time() - began_s)
    writer.close()


async def test_requests_that_are_hung_up_or_refused_keep_no_command_waiting(call):
    """What a client no longer wants, and what comes from another site, takes no share of the others."""
    loop = asyncio.get_running_loop()
    for request, count in (
        (b"GET /commands HTTP/1.1\r\nHost: localhost\r\n\r\n", 300),
        (b"GET /state HTTP/1.1\r\nHost: evil.example\r\n\r\n", 200),
    ):
        for _ in range(count):
            _, writer = await asyncio.open_connection("127.0.0.1", call.port)
            writer.write(request)
            await writer.drain()
            writer.transport.abort()
    began_s = loop.time()
    assert (await call("POST", "/commands/mode", {"mode": "GUIDED"}))[0] == 200
    assert loop.time() - began_s < 3.0


async def test_who_comes_when_too_many_wait_is_told_to_come_again_and_a_command_is_let_in(call):
    """Forty-five connections, of the 64 that are served, ask again and again."""

    async def flood():
        reader, writer = await asyncio.open_connection("127.0.0.1", call.port)
        with contextlib.closing(writer):
            while True:
                writer.write(b"GET /commands HTTP/1.1\r\nHost: localhost\r\n\r\n")
                head = await reader.readuntil(b"\r\n\r\n")
                length = int(head.lower().split(b"content-length: ")[1].split()[0])
                heads.append(head)
                await reader.readexactly(length)

    heads = []
    loop = asyncio.get_running_loop()
    floods = [asyncio.create_task(flood()) for _ in range(45)]
    try:
        began_s = loop.time()
        while not any(b" 429 " in head for head in heads):
            await asyncio.sleep(0.01)
            assert loop.time() - began_s < 10.0
        for _ in range(3):
            began_s = loop.time()
            assert (await call("POST", "/commands/mode", {"mode": "GUIDED"}))[0] == 200
            assert loop.time() - began_s < 3.0
    finally:
        for task in floods:
            task.cancel()
        await asyncio.gather(*floods, return_exceptions=True)
    assert all(b"\r\nretry-after: 1\r\n" in head for head in heads if b" 429 " in head)
    assert {head.split()[1] for head in heads} == {b"200", b"429"}
