"""What the radio router costs per delivery, as a multiple of a bare Zenoh fan-out with the same clients.

Both run in a process of their own with a Zenoh router session: the bare one puts each packet on one key per
receiver and does nothing else; ours decides each packet's fate by `moon2020` (at 100 m, so that all arrive), books
it, writes its rows and forwards it. Ticks and truth, which cost the same whatever is transmitted, are not in it. Rounds
alternate; the figures are medians of CPU time per delivery.

    python -m benchmarks.bench_router [--receivers 1 10 50] [--rounds 3] [--json]
"""

from __future__ import annotations

import argparse
import json
import multiprocessing as mp
import statistics
import tempfile
import threading
import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from bridge.bus.keys import Keys
from bridge.bus.session import Sample, Session, Stamp, free_port, open_client, open_router
from bridge.radio.deliveries import DeliveryColumns
from bridge.radio.virtual_radio import Forward, VirtualRadio
from channel.link.radio import Radio
from channel.medium.medium import Medium
from channel.presets import load_radio

KEYS = Keys("bench")
PAYLOAD = bytes(324)
RATE_HZ = 500
PACKETS = 1500
LEVEL = (1.0, 0.0, 0.0, 0.0)


def bare_fan_out(session: Session, nodes: list[str], _folder: Path) -> Callable[[Sample], None]:
    """A packet to one key per receiver, with nothing decided."""
    keys = [KEYS.rx(node, "0", "team") for node in nodes[1:]]

    def forward(sample: Sample) -> None:
        for key in keys:
            session.put_bytes(key, sample.payload, attachment=sample.attachment)

    return forward


def radio_router(session: Session, nodes: list[str], folder: Path) -> Callable[[Sample], None]:
    """Our core with its record, in Zenoh's thread (its process adds a queue of its own)."""
    medium = Medium(Radio(load_radio("moon2020")), seed=1, nodes=nodes)
    core = VirtualRadio(KEYS, medium, nodes)
    writer = DeliveryColumns(folder, nodes)
    for tick_ns in (0, 3600 * 10**9):
        for i, node in enumerate(nodes):
            core.on_truth(node, tick_ns, (100.0 if i else 0.0, float(i), -40.0), LEVEL)

    def forward(sample: Sample) -> None:
        payload, stamp = sample.payload.to_bytes(), Stamp.from_sample(sample)
        core.on_packet("0", "team", payload, sample.encoding, stamp)
        for action in core.settle():
            if isinstance(action, Forward):
                session.put_bytes(
                    action.key, payload, encoding=action.packet.encoding, attachment=action.attachment
                )
        writer.write(core.settled)
        core.settled.clear()

    return forward


def serve(kind: str, endpoint: str, nodes: list[str], pipe: Connection) -> None:
    """The measured process: reports its CPU time whenever asked."""
    with open_router(endpoint) as session, tempfile.TemporaryDirectory() as folder:
        make = {"bare": bare_fan_out, "router": radio_router}[kind]
        session.subscribe(KEYS.tx("*", "*"), make(session, nodes, Path(folder)))
        pipe.send("ready")
        while pipe.recv() == "cpu":
            pipe.send(time.process_time())


def receive(endpoint: str, nodes: list[str], expected: int, pipe: Connection) -> None:
    """All receivers, a session each, in a process of their own."""
    done, lock, count = threading.Event(), threading.Lock(), 0

    def on_sample(_sample: Sample) -> None:
        nonlocal count
        with lock:
            count += 1
            if count >= expected:
                done.set()

    sessions = [open_client(endpoint) for _ in nodes[1:]]
    for session, node in zip(sessions, nodes[1:], strict=True):
        session.subscribe(KEYS.rx(node, "*", "*"), on_sample)
    pipe.send("ready")
    pipe.recv()
    done.wait(60)
    pipe.send(count)
    for session in sessions:
        session.close()


def measure(kind: str, receivers: int) -> float:
    """CPU time of the serving process per delivery, us."""
    context = mp.get_context("spawn")
    endpoint, nodes = f"tcp/127.0.0.1:{free_port()}", [str(i) for i in range(receivers + 1)]
    server_pipe, server_end = context.Pipe()
    receiver_pipe, receiver_end = context.Pipe()
    server = context.Process(target=serve, args=(kind, endpoint, nodes, server_end), daemon=True)
    server.start()
    server_pipe.recv()
    expected = PACKETS * receivers
    receiver = context.Process(target=receive, args=(endpoint, nodes, expected, receiver_end), daemon=True)
    receiver.start()
    receiver_pipe.recv()
    with open_client(endpoint) as sender:
        time.sleep(0.3)  # Zenoh has no event for "the subscription has reached me"; a benchmark may wait
        before_s = _cpu(server_pipe)
        receiver_pipe.send("count")
        _transmit(sender)
        delivered = receiver_pipe.recv()
        used_s = _cpu(server_pipe) - before_s
    server_pipe.send("end")
    receiver.join(10)
    server.join(10)
    if delivered < 0.99 * expected:
        raise RuntimeError(f"{kind}, {receivers} receivers: only {delivered} of {expected} arrived")
    return float(used_s / delivered * 1e6)


def _cpu(pipe: Connection) -> float:
    pipe.send("cpu")
    return float(pipe.recv())


def _transmit(sender: Session) -> None:
    start = time.monotonic()
    for seq in range(PACKETS):
        pause_s = start + seq / RATE_HZ - time.monotonic()
        if pause_s > 0:
            time.sleep(pause_s)
        stamp = Stamp(seq, seq * 1_000_000).to_bytes()
        sender.put_bytes(KEYS.tx("0", "team"), PAYLOAD, attachment=stamp, must_arrive=True)


def main(argv: list[str] | None = None) -> dict[str, Any]:
    """Run the benchmark; prints and returns the figures."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.bench_router", description=__doc__)
    parser.add_argument("--receivers", type=int, nargs="+", default=[1, 10])
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args(argv)
    result: dict[str, Any] = {"benchmark": "router", "rows": []}
    for receivers in arguments.receivers:
        rounds = [(measure("bare", receivers), measure("router", receivers)) for _ in range(arguments.rounds)]
        bare_us, router_us = (statistics.median(column) for column in zip(*rounds, strict=True))
        ratio = statistics.median(router / bare for bare, router in rounds)
        row = {"receivers": receivers, "bare_us": bare_us, "router_us": router_us, "ratio": ratio}
        result["rows"].append(row)
        if not arguments.json:
            print(
                f"router: {receivers} receivers: {router_us:.1f} us CPU per delivery, "
                f"bare fan-out {bare_us:.1f} us, ratio {ratio:.2f}",
                flush=True,
            )
    if arguments.json:
        print(json.dumps(result))
    return result


if __name__ == "__main__":
    main()
