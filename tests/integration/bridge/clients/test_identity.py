"""A router with the rules of a run: who gets in, and what each may write, read, ask and answer.

What each may do is written down here by hand, from the design's key space, not taken from the table of rights.
"""

from __future__ import annotations

import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import psutil
import pytest
import zenoh

from bridge.bus.identity.keyring import OBSERVERS, Credentials
from bridge.bus.session import SessionError, open_client
from tests.integration.bridge.clients.guarded import (
    LONG_S,
    PREFIX,
    Guarded,
    Heard,
    guarded_router,
    plain_config,
)

NODE_KEYS = ("state", "tx/main/all/team", "rx/9/team", "comm_status", "agent", "answer")
PHYSICS = {"truth/0", "truth/1", "clock", "clock/exchange", "tick/truth", "tick/fates"}
COMMON = {"clock", "clock/exchange", "clock/release", "clock/end", "clock/start"}
OTHER = {
    "truth/0",
    "truth/1",
    "link/0/1",
    "tick/fates",
    "tick/truth",
    "ending",
    "host/host-0/heard",
    "host/host-1/heard",
}
ALL = [*(f"node/{node}/{key}" for node in "01" for key in NODE_KEYS), *sorted(OTHER | COMMON)]
ALL += ["node/1/cmd/arm", "clock/cmd/pause", "alive/host-0", "elsewhere"]


def of_node(node: str, *keys: str) -> set[str]:
    return {f"node/{node}/{key}" for key in keys}


WRITES = {
    "physics": PHYSICS,
    "host-0": of_node("0", "state", "tx/main/all/team", "agent", "answer"),
    "host-1": of_node("1", "state", "tx/main/all/team", "agent", "answer"),
    "node-0": of_node("0", "tx/main/all/team", "agent"),
    "node-1": of_node("1", "tx/main/all/team", "agent"),
    "node-2": set(),  # an agent of ours speaks for it
    "supervisor": {"clock/start"},
    "operator": set(),
    "observer": set(),
}
PUBLIC = {
    *(key for node in "01" for key in of_node(node, "state", "rx/9/team", "comm_status", "agent", "answer")),
    *COMMON,
    *("truth/0", "truth/1", "tick/fates", "tick/truth", "ending"),
}
READS = {
    "physics": {"clock", "clock/release", "clock/end", "clock/start"},
    "host-0": COMMON | {k for k in PUBLIC if k.startswith("node/0/")} | {"host/host-0/heard"},
    "host-1": COMMON | {k for k in PUBLIC if k.startswith("node/1/")} | {"host/host-1/heard"},
    "node-0": COMMON | {k for k in PUBLIC if k.startswith("node/0/")},
    "node-1": COMMON | {k for k in PUBLIC if k.startswith("node/1/")},
    "node-2": COMMON,
    "supervisor": PUBLIC,
    "operator": PUBLIC,
    "observer": PUBLIC,
}


@pytest.fixture(scope="module")
def router(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Guarded]:
    with guarded_router(tmp_path_factory.mktemp("run") / "secrets") as guarded:
        yield guarded


@pytest.mark.parametrize("name", WRITES)
def test_each_writes_its_own_keys_only(router: Guarded, name: str) -> None:
    at_router, at_client = Heard(), Heard()
    with router.client(name) as client:
        router.session.subscribe("**", at_router)
        for key in ALL:
            client.put_bytes(PREFIX + key, b"x", must_arrive=True)
        client.subscribe(f"{PREFIX}clock", at_client)
        for _ in range(3):  # the way there and back, three times
            at_client.keys.clear()
            at_client.wait_for("clock", lambda: router.put_all(["clock"]))
        for key in WRITES[name]:
            at_router.wait_for(key)
    assert set(at_router.keys) - ({"clock"} - WRITES[name]) == WRITES[name]


@pytest.mark.parametrize("name", READS)
def test_each_reads_its_own_keys_only_whatever_it_subscribes_to(router: Guarded, name: str) -> None:
    heard = Heard()
    with router.client(name) as client:
        for key in ["**", "lostlink/**", f"{PREFIX}node/*/rx/**", f"{PREFIX}node/1/**", f"{PREFIX}node/0/**"]:
            client.subscribe(key, heard)
        marker = "clock/release"
        rest = [key for key in ALL if key != marker]
        for key in [*rest, marker]:
            client.subscribe(PREFIX + key, heard)
        for _ in range(5):  # a marker may come late, of the round before
            heard.wait_for(marker, lambda: router.put_all([*rest, marker]))
            heard.keys.remove(marker)
        heard.wait_for(marker, lambda: router.put_all([*rest, marker]))
    assert set(heard.keys) == READS[name]


@pytest.mark.parametrize(
    ("user", "password"),
    [("", ""), ("node-1", "guess"), ("node-1", ""), ("observer", ""), ("root", "observer")],
)
def test_without_the_password_nobody_gets_in(router: Guarded, user: str, password: str) -> None:
    with pytest.raises(zenoh.ZError), router.stranger(user, password):
        pass
    wrong = Credentials(user, password) if user else None
    with pytest.raises(SessionError, match=f"router at {router.endpoint} does not let {user or 'nobody'} in"):
        open_client(router.endpoint, wrong)


def test_a_router_that_is_not_there_is_told_apart_from_one_that_refuses() -> None:
    with pytest.raises(SessionError, match="no Zenoh router answers at tcp"):
        open_client("tcp/127.0.0.1:1", OBSERVERS)


def test_declared_publishers_send_and_only_on_their_own_keys(router: Guarded) -> None:
    heard = Heard()
    router.session.subscribe(f"{PREFIX}node/*/tx/**", heard)
    own = router.keyring.credentials("node-1")
    with router.stranger(own.user, own.password) as session:
        foreign = session.declare_publisher(f"{PREFIX}node/0/tx/main/all/team")
        mine = session.declare_publisher(f"{PREFIX}node/1/tx/main/all/team")

        def put() -> None:
            foreign.put(b"x")
            mine.put(b"x")

        heard.wait_for("node/1/tx/main/all/team", put)
    assert set(heard.keys) == {"node/1/tx/main/all/team"}


def test_who_publishes_is_told_that_somebody_may_listen_and_not_of_those_who_may_not(tmp_path: Path) -> None:
    marker, told = Heard(), threading.Event()
    with guarded_router(tmp_path / "secrets") as router:
        physics, node, observer = (
            router.keyring.credentials(name) for name in ("physics", "node-0", "observer")
        )
        with (
            router.stranger(physics.user, physics.password) as session,
            router.stranger(node.user, node.password) as nosy,
            router.stranger(observer.user, observer.password) as looker,
        ):
            publisher = session.declare_publisher(f"{PREFIX}truth/0")
            publisher.declare_matching_listener(lambda status: told.set() if status.matching else None)
            nosy.declare_subscriber(f"{PREFIX}truth/0", Heard())
            nosy.declare_subscriber(f"{PREFIX}clock", marker)
            marker.wait_for("clock", lambda: router.put_all(["clock"]))
            assert not told.is_set()
            assert publisher.matching_status.matching is False
            looker.declare_subscriber("lostlink/*/truth/*", Heard())
            assert told.wait(LONG_S)
            assert publisher.matching_status.matching is True


def test_the_ten_line_subscriber_reads_what_was_delivered(router: Guarded) -> None:
    heard = Heard()
    with router.stranger("observer", "observer") as session:
        session.declare_subscriber("lostlink/*/node/*/rx/**", heard)
        heard.wait_for("node/1/rx/9/team", lambda: router.put_all(["node/1/rx/9/team"]))


def replies(session: zenoh.Session, key: str) -> list[str]:
    return [
        str(r.ok.key_expr).removeprefix(PREFIX) for r in session.get(key, timeout=LONG_S) if r.ok is not None
    ]


def test_commands_reach_the_aircraft_of_operators_and_of_its_own_node(router: Guarded) -> None:
    def answer(query: zenoh.Query) -> None:
        with query:
            query.reply(query.key_expr, b"done")

    with (
        router.client("host-1") as host,
        router.client("host-0") as other_host,
        router.client("node-1") as thief,
    ):
        host.serve(f"{PREFIX}node/1/cmd/arm", answer)
        other_host.serve(f"{PREFIX}node/0/cmd/arm", answer)
        stolen: list[zenoh.Query] = []
        thief.serve(f"{PREFIX}node/0/cmd/arm", stolen.append)
        thief.serve(f"{PREFIX}node/1/cmd/arm", stolen.append)
        other_host.serve(f"{PREFIX}node/1/cmd/arm", stolen.append)
        got = {}
        for name in ("operator", "node-1", "node-0", "observer", "physics", "host-0", "supervisor"):
            known = router.keyring.credentials(name)
            with router.stranger(known.user, known.password) as session:

                def ask(session: zenoh.Session = session) -> list[list[str]]:
                    return [replies(session, f"{PREFIX}node/{node}/cmd/arm") for node in "01"]

                while name == "operator" and [] in ask():
                    pass  # until the hosts' declarations have come to the router
                got[name] = ask()
                assert replies(session, f"{PREFIX}node/*/cmd/arm") == []  # a command is for one aircraft
    nothing: list[str] = []
    assert got.pop("operator") == [["node/0/cmd/arm"], ["node/1/cmd/arm"]]
    assert got.pop("node-1") == [nothing, ["node/1/cmd/arm"]]
    assert got.pop("node-0") == got.pop("host-0") == [["node/0/cmd/arm"], nothing]
    assert all(answers == [nothing, nothing] for answers in got.values()), got
    assert stolen == []


def test_who_looks_may_ask_all_nodes_whatever_host_they_are_on(router: Guarded) -> None:
    def answer(query: zenoh.Query, node: str) -> None:
        with query:
            query.reply(f"{PREFIX}node/{node}/mavlink/HEARTBEAT", b"{}")

    with router.client("host-0") as host_0, router.client("host-1") as host_1:
        host_0.serve(f"{PREFIX}node/0/mavlink/*", partial(answer, node="0"))
        host_1.serve(f"{PREFIX}node/1/mavlink/*", partial(answer, node="1"))
        with router.stranger("observer", "observer") as session:
            for node in "01":
                while not replies(session, f"{PREFIX}node/{node}/mavlink/HEARTBEAT"):
                    pass  # until the hosts' declarations have come to the router
            heard = replies(session, f"{PREFIX}node/*/mavlink/HEARTBEAT")
    assert sorted(heard) == ["node/0/mavlink/HEARTBEAT", "node/1/mavlink/HEARTBEAT"]


def test_only_a_process_says_that_it_is_there_and_nodes_do_not_see_it(router: Guarded) -> None:
    tokens: list[tuple[str, bool]] = []
    seen_by_node: list[tuple[str, bool]] = []
    there = threading.Event()

    def on_token(key: str, is_alive: bool) -> None:
        tokens.append((key.removeprefix(PREFIX), is_alive))
        if key.endswith("/host-1"):
            there.set()

    with (
        router.client("supervisor") as supervisor,
        router.client("node-1") as node,
        router.client("node-1") as liar,
    ):
        supervisor.watch_alive(f"{PREFIX}alive/*", on_token)
        node.watch_alive(f"{PREFIX}alive/*", lambda key, is_alive: seen_by_node.append((key, is_alive)))
        node.watch_alive(f"{PREFIX}alive/host-1", lambda key, is_alive: seen_by_node.append((key, is_alive)))
        liar.declare_alive(f"{PREFIX}alive/host-1")
        with router.client("host-0") as host_0, router.client("host-1") as host_1:
            host_0.declare_alive(f"{PREFIX}alive/host-1")
            host_0.declare_alive(f"{PREFIX}alive/physics")
            heard = Heard()
            node.subscribe(f"{PREFIX}clock", heard)
            heard.wait_for("clock", lambda: router.put_all(["clock"]))
            assert tokens == []
            host_1.declare_alive(f"{PREFIX}alive/host-1")
            assert there.wait(LONG_S)
    assert tokens[0] == ("alive/host-1", True)
    assert {key for key, _ in tokens} == {"alive/host-1"}
    assert seen_by_node == []


@pytest.mark.parametrize("name", ["observer", "operator", "node-1", "host-0", "supervisor"])
def test_the_admin_space_of_the_router_is_closed(router: Guarded, name: str) -> None:
    known = router.keyring.credentials(name)
    with router.stranger(known.user, known.password) as session:
        (routers_id,) = session.info.routers_zid()
        for key in ("@/**", f"@/{routers_id}/**", f"@/{routers_id}/router"):
            assert [reply for reply in replies(session, key) if str(routers_id) in reply.split("/")[1]] == []
        session.put(f"@/{routers_id}/router/config/mode", b'"peer"')
        assert list(session.liveliness().get("@/**", timeout=LONG_S)) == []


@pytest.mark.parametrize("mode", ["peer", "router"])
def test_other_modes_gossip_and_scouting_open_no_way_past_the_radio(router: Guarded, mode: str) -> None:
    """Two sessions that want to find each other know of the router only, which tells neither of the other."""
    heard, at_router = Heard(), Heard()
    router.session.subscribe("**", at_router)
    eager = {
        "mode": mode,
        "listen__endpoints": ["tcp/127.0.0.1:0"],
        "scouting__gossip__enabled": True,
        "scouting__gossip__multihop": True,
        "scouting__gossip__autoconnect": {"router": ["peer", "router"], "peer": ["peer", "router"]},
    }
    first, second = (router.keyring.credentials(name) for name in ("node-0", "node-1"))
    with (
        router.stranger(first.user, first.password, **eager) as one,
        router.stranger(second.user, second.password, **eager) as two,
    ):
        (routers_id,) = one.info.routers_zid()
        two.declare_subscriber("**", heard)
        two.declare_subscriber(f"{PREFIX}node/1/rx/**", heard)
        own, foreign = f"{PREFIX}node/0/tx/main/all/team", f"{PREFIX}node/1/rx/0/team"

        def put() -> None:
            one.put(foreign, b"past the radio")
            one.put(f"{PREFIX}node/0/rx/0/team", b"past the radio")
            one.put(own, b"x")
            router.put_all(["node/0/rx/9/team", "node/1/rx/9/team"])

        heard.wait_for("node/1/rx/9/team", put)
        at_router.wait_for("node/0/tx/main/all/team", put)
        assert set(heard.keys) == {"node/1/rx/9/team"}
        assert not {"node/0/rx/0/team", "node/1/rx/0/team"} & set(at_router.keys)
        for session in (one, two):
            assert session.info.routers_zid() == [routers_id]
            assert session.info.peers_zid() == []


def test_scouting_does_not_find_the_router(router: Guarded) -> None:
    settings = {"mode": "router", "listen__endpoints": ["tcp/127.0.0.1:0"], "scouting__delay": 0}
    with zenoh.open(plain_config(**settings)) as findable, router.stranger("observer", "observer") as session:
        (routers_id,) = session.info.routers_zid()
        found: set[str] = set()
        scout = zenoh.scout(what="router|peer", config=zenoh.Config())
        until = time.monotonic() + 2.0
        while str(findable.zid()) not in found and time.monotonic() < until:
            hello = scout.try_recv()
            found |= set() if hello is None else {str(hello.zid)}
        scout.stop()
    if str(findable.zid()) not in found:
        pytest.skip("there is no multicast on this machine")
    assert str(routers_id) not in found


def test_a_peer_lends_its_rights_to_nobody(router: Guarded) -> None:
    """Who connects to a client's own listener is not at the router; what the client passes on counts as its own."""
    heard = Heard()
    router.session.subscribe("**", heard)
    known = router.keyring.credentials("node-1")
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        door = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    opened = {"mode": "peer", "listen__endpoints": [door]}
    with router.stranger(known.user, known.password, **opened) as session:
        with pytest.raises(zenoh.ZError), router.stranger(connect__endpoints=[door], mode="client"):
            pass
        session.put(f"{PREFIX}node/0/tx/main/all/team", b"x")
        heard.wait_for("node/1/agent", lambda: session.put(f"{PREFIX}node/1/agent", b"x"))
    assert set(heard.keys) == {"node/1/agent"}


def addresses_for_others() -> list[str]:
    return [
        address.address
        for name, known in psutil.net_if_addrs().items()
        for address in known
        if name not in ("lo", "lo0") and address.family is socket.AF_INET
    ]


FROM_OUTSIDE = """\
from pathlib import Path
from bridge.bus.identity.logins import LoginWatch
from tests.integration.bridge.clients.guarded import Heard, guarded_router

told, observer, operator = [], Heard(), Heard()
with LoginWatch(lambda *refusal: told.append(refusal)), guarded_router(Path({path!r}), {host!r}) as router:
    with router.client("observer") as outside, router.client("operator") as inside:
        outside.subscribe("lostlink/*/node/*/rx/**", observer)
        inside.subscribe("lostlink/*/node/*/rx/**", operator)
        for _ in range(3):
            operator.keys.clear()
            operator.wait_for("node/1/rx/9/team", lambda: router.put_all(["node/1/rx/9/team"]))
print(observer.keys, told)
"""


@pytest.mark.skipif(not addresses_for_others(), reason="this machine has a loopback interface only")
def test_observers_have_no_rights_from_another_machine(tmp_path: Path) -> None:
    """The same router on an interface that is not loopback: its observer gets nothing, its operator does."""
    script = FROM_OUTSIDE.format(path=str(tmp_path / "secrets"), host=addresses_for_others()[0])
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60)
    assert (done.stdout, done.stderr) == ("[] [('no_rights', 1)]\n", "")


CUT_OFF = """\
import threading
from pathlib import Path
from bridge.bus.identity.logins import LoginWatch
from tests.integration.bridge.clients.guarded import PREFIX, guarded_router

told, cut_off, gone, go_on = [], threading.Event(), threading.Event(), threading.Event()

def watch(key, is_alive):
    told.append(is_alive)
    if not is_alive:
        gone.set()

with LoginWatch(print, lambda _: cut_off.set()), guarded_router(Path({path!r})) as router:
    router.session.declare_alive(PREFIX + "alive/router")
    with router.client("observer") as reader:
        reader.watch_alive(PREFIX + "alive/router", watch)
        reader.subscribe(PREFIX + "clock", lambda _: go_on.wait())
        wanted = router.session.interest(PREFIX + "clock")
        while not wanted():
            pass
        while not cut_off.is_set():
            router.session.put_bytes(PREFIX + "clock", bytes(60000), must_arrive=True)
        go_on.set()
        gone.wait(20.0)
print(told[:2])
"""


@pytest.mark.slow
def test_a_reader_that_is_cut_off_is_counted_and_sees_it(tmp_path: Path) -> None:
    """What has to arrive waits for it for a second; then it loses samples, and the router goes and comes for it."""
    script = CUT_OFF.format(path=str(tmp_path / "secrets"))
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60)
    assert (done.stdout, done.stderr) == ("[True, False]\n", "")
