"""What coding a message costs, beside rosbags with its own classes on the same values.

Rounds alternate; the figures are medians, in ns. The bytes of both are compared before.

    python -m benchmarks.bench_messages [--rounds 7] [--calls 5000] [--json]
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
from collections.abc import Callable
from functools import cache
from timeit import timeit
from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from bridge.bus.messages import (
    AircraftState,
    Clock,
    CommandEvent,
    CommunicationStatus,
    DataPackage,
    Header,
    Message,
    Quaternion,
    Truth,
    Vector3,
    Waypoint,
    decode,
    encode,
)
from bridge.bus.messages.definitions import PRIMITIVES, definitions, fields_of

NODES = 8
HEADER = Header.at(12_345_678_901, "1")
STATE = AircraftState(
    HEADER,
    2,
    Vector3(0.1, -0.2, 3.0),
    -105.24,
    40.13,
    mode="GUIDED",
    base_mode="CUSTOM|GUIDED|ARMED",
    armed=True,
)
EXAMPLES = (
    DataPackage(HEADER, 2412, STATE, (Waypoint(-105.0, 40.0, 40.0),) * 2, (-80.5,)),
    STATE,
    Truth(HEADER, -105.0, 40.0, 1700.0, Vector3(1.0, 2.0, 3.0), attitude=Quaternion(0.0, 0.0, 0.0, 1.0)),
    Clock(HEADER, 1.0, 0.99),
    CommandEvent(CommandEvent.FEEDBACK, True, "on its way", 12.5),
    CommunicationStatus(HEADER, tuple(map(str, range(NODES))), (True,) * NODES),
    HEADER,
)


@cache
def store() -> Any:
    """The typestore of rosbags, from the texts of the definitions alone."""
    made, found = get_typestore(Stores.EMPTY), {}
    for name, text in definitions().items():
        found |= get_types_from_msg(text, name)
    made.register(found)
    return made


def for_rosbags(message: Message) -> Any:
    """The same in the classes of rosbags, whose sequences of numbers are arrays."""
    return store().types[message.TYPE](
        *(
            _for_rosbags(getattr(message, field.name), field.type, field.is_sequence)
            for field in fields_of(message.TYPE)
        )
    )


def _for_rosbags(value: Any, kind: str, is_sequence: bool) -> Any:
    if is_sequence and kind in PRIMITIVES:
        return np.asarray(list(value), dtype=PRIMITIVES[kind])
    if is_sequence:
        return [_for_rosbags(item, kind, False) for item in value]
    return for_rosbags(value) if isinstance(value, Message) else value


def measure(message: Message, rounds: int, calls: int) -> dict[str, Any]:
    """ns per call of both, and the ratios."""
    kind, raw, other, rosbags = type(message), encode(message), for_rosbags(message), store()
    if raw != bytes(rosbags.serialize_cdr(other, kind.TYPE)):
        raise RuntimeError(f"{kind.TYPE}: not the bytes of rosbags")
    ways: dict[str, Callable[[], object]] = {
        "encode": lambda: encode(message),
        "encode_rosbags": lambda: rosbags.serialize_cdr(other, kind.TYPE),
        "decode": lambda: decode(raw, kind),
        "decode_rosbags": lambda: rosbags.deserialize_cdr(raw, kind.TYPE),
    }
    taken: dict[str, list[float]] = {name: [] for name in ways}
    for _ in range(rounds):
        for name, way in ways.items():
            taken[name].append(timeit(way, number=calls) / calls * 1e9)
    figures = {name: round(statistics.median(values)) for name, values in taken.items()}
    return {"message": kind.__name__, "length_bytes": len(raw), **figures}


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--calls", type=int, default=5000)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args(arguments)
    rows = [measure(message, options.rounds, options.calls) for message in EXAMPLES]
    if options.json:
        print(json.dumps(rows))
        return 0
    print(f"{'ns':<20} {'bytes':>6} {'encode':>7} {'rosbags':>8} {'decode':>7} {'rosbags':>8}")
    for row in rows:
        figures = (row[name] for name in ("encode", "encode_rosbags", "decode", "decode_rosbags"))
        print("{:<20} {:>6} {:>7} {:>8} {:>7} {:>8}".format(row["message"], row["length_bytes"], *figures))
    return 0


if __name__ == "__main__":
    sys.exit(main())
