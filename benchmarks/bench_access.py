"""What passwords and rules cost: CPU time of the router per delivery, with the guard of a run and without.

Both run in a process of their own with a Zenoh router session that puts each packet of node 0 on one key per receiver,
and does nothing else. The receivers have a session each, in one process. Rounds alternate; the figures are medians. A
guard has rules for all nodes and for two hosts. Refused: node 0 writes to a key that is not its own, as fast as it can.

    python -m benchmarks.bench_access [--receivers 1 10 50] [--packets 2000] [--rounds 5] [--json]
"""

from __future__ import annotations

import argparse
import json
import multiprocessing as mp
import statistics
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from bridge.bus.identity.guard import RouterGuard
from bridge.bus.identity.keyring import Keyring
from bridge.bus.identity.roster import node_identity, roster
from bridge.bus.identity.rules import access_control
from bridge.bus.keys import Keys
from bridge.bus.session import Sample, Session, free_port, open_client, open_router

RUN = "bench"
KEYS = Keys(RUN)
PAYLOAD = bytes(324)
AHEAD = 50
"""Packets that may be on their way at once, so that no queue fills."""
WAIT_S = 60.0


@dataclass(frozen=True)
class Place:
    """Where a router is, and how to get in; without a keyring everybody gets in."""

    endpoint: str
    nodes: tuple[str, ...]
    keyring: Keyring | None

    def join(self, node: str) -> Session:
        credentials = self.keyring.credentials(node_identity(node)) if self.keyring else None
        return open_client(self.endpoint, credentials)


def serve(place: Place, pipe: Connection) -> None:
    """The measured process: says how long it took to open, then its CPU time whenever asked."""
    start = time.monotonic()
    guard = RouterGuard(RUN, place.keyring) if place.keyring else None
    with open_router(place.endpoint, guard) as session:
        opened_s = time.monotonic() - start
        keys = [KEYS.rx(node, "0", "team") for node in place.nodes[1:]]

        def forward(sample: Sample) -> None:
            for key in keys:
                session.put_bytes(key, sample.payload, attachment=sample.attachment, must_arrive=True)

        session.subscribe(KEYS.tx("*", "*"), forward)
        pipe.send(opened_s)
        while pipe.recv() == "cpu":
            pipe.send(time.process_time())


def receive(place: Place, pipe: Connection) -> None:
    """All receivers, a session each; returns how many packets the slowest of them has."""
    counts = dict.fromkeys(place.nodes[1:], 0)
    sessions = [place.join(node) for node in counts]
    lock = threading.Lock()

    def on_sample(node: str) -> None:
        with lock:
            counts[node] += 1

    for session, node in zip(sessions, counts, strict=True):
        session.subscribe(KEYS.rx(node, "*", "*"), lambda _, node=node: on_sample(node))  # type: ignore[misc]
    pipe.send("ready")
    while pipe.recv() == "count":
        pipe.send(min(counts.values()))
    for session in sessions:
        session.close()


@contextmanager
def running(target: Any, place: Place) -> Iterator[Connection]:
    """A process at the other end of a pipe, which ends on any word that it does not know."""
    context = mp.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=target, args=(place, theirs), daemon=True)
    process.start()
    try:
        yield ours
    finally:
        ours.send("end")
        process.join(10)


def ask(pipe: Connection, what: str) -> float:
    pipe.send(what)
    return float(pipe.recv())


def measure(receivers: int, packets: int, keyring: Keyring | None) -> dict[str, float]:
    """CPU time of the router per delivery and, with a guard, per refused packet, in us; how long it took to open."""
    nodes = tuple(str(i) for i in range(receivers + 1))
    place = Place(f"tcp/127.0.0.1:{free_port()}", nodes, keyring)
    with running(serve, place) as router:
        result = {"open_ms": 1e3 * router.recv()}
        with running(receive, place) as receiver, place.join("0") as sender:
            receiver.recv()
            meet(sender, receiver)
            before_s = ask(router, "cpu")
            start = time.perf_counter()
            send(sender, receiver, packets, ahead=AHEAD)
            result["wall_us"] = (time.perf_counter() - start) / packets / receivers * 1e6
            result["delivery_us"] = (ask(router, "cpu") - before_s) / packets / receivers * 1e6
            if keyring is not None:
                before_s = ask(router, "cpu")
                for _ in range(packets):
                    sender.put_bytes(KEYS.rx("1", "0", "team"), PAYLOAD, must_arrive=True)
                meet(sender, receiver)  # it comes after all those that were refused
                result["refused_us"] = (ask(router, "cpu") - before_s) / packets * 1e6
    return result


def meet(sender: Session, receiver: Connection) -> None:
    """Transmit now and then until everybody has received something new: then all subscriptions are at the router."""
    at_first = ask(receiver, "count")
    deadline = time.monotonic() + WAIT_S
    while ask(receiver, "count") == at_first:
        if time.monotonic() > deadline:
            raise RuntimeError("not everybody receives")
        sender.put_bytes(KEYS.tx("0", "team"), PAYLOAD, must_arrive=True)
        time.sleep(
            0.05
        )  # Zenoh has no event for "the subscription has reached the router"; a benchmark may wait


def send(sender: Session, receiver: Connection, packets: int, *, ahead: int) -> None:
    """Transmit, never more than ``ahead`` packets beyond what all have received; return when all have all."""
    at_first = ask(receiver, "count")
    deadline = time.monotonic() + WAIT_S
    sent = 0
    while (received := ask(receiver, "count") - at_first) < packets:
        if time.monotonic() > deadline:
            raise RuntimeError(f"only {received:.0f} of {packets} packets arrived everywhere")
        room = min(packets - sent, ahead - (sent - int(received)))
        for _ in range(room):
            sender.put_bytes(KEYS.tx("0", "team"), PAYLOAD, must_arrive=True)
        sent += room
        if room <= 0:
            time.sleep(0.001)


def main(argv: list[str] | None = None) -> dict[str, Any]:
    """Run the benchmark; prints and returns the figures."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.bench_access", description=__doc__)
    parser.add_argument("--receivers", type=int, nargs="+", default=[1, 10, 50])
    parser.add_argument("--packets", type=int, default=2000)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args(argv)
    rows = [row_of(k, arguments.packets, arguments.rounds) for k in arguments.receivers]
    if arguments.json:
        print(json.dumps(rows))
    else:
        for row in rows:
            print("  ".join(f"{name} {value:.4g}" for name, value in row.items()), flush=True)
    return {"benchmark": "access", "rows": rows}


def row_of(receivers: int, packets: int, rounds: int) -> dict[str, float]:
    nodes = [str(i) for i in range(receivers + 1)]
    identities = roster(nodes, {"host-0": nodes[::2], "host-1": nodes[1::2]}, free=nodes)
    rules = access_control(RUN, identities)["rules"]
    with tempfile.TemporaryDirectory() as folder:
        keyring = Keyring.create(Path(folder) / "secrets", identities)
        pairs = [
            (measure(receivers, packets, None), measure(receivers, packets, keyring)) for _ in range(rounds)
        ]
    row: dict[str, float] = {
        "receivers": receivers,
        "rules": len(rules),
        "keys_in_rules": sum(len(rule["key_exprs"]) for rule in rules),
    }
    for name in ("open_ms", "delivery_us", "wall_us"):
        row |= {f"{name}_open": statistics.median(open_[name] for open_, _ in pairs)}
        row |= {f"{name}_guarded": statistics.median(guarded[name] for _, guarded in pairs)}
    row["ratio"] = statistics.median(
        guarded["delivery_us"] / open_["delivery_us"] for open_, guarded in pairs
    )
    row["refused_us"] = statistics.median(guarded["refused_us"] for _, guarded in pairs)
    return row


if __name__ == "__main__":
    main()
