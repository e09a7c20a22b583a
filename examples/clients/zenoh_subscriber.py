"""Print what the radio delivers in a run: python zenoh_subscriber.py [tcp/127.0.0.1:7447]. Ctrl-C ends it."""

import contextlib
import json
import sys

import zenoh

config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5(
    "connect/endpoints", json.dumps([sys.argv[1] if len(sys.argv) > 1 else "tcp/127.0.0.1:7447"])
)
config.insert_json5("transport/auth/usrpwd/user", '"observer"')
config.insert_json5("transport/auth/usrpwd/password", '"observer"')
with zenoh.open(config) as session, contextlib.suppress(KeyboardInterrupt, BrokenPipeError):
    subscriber = session.declare_subscriber("lostlink/*/node/*/rx/**")
    for sample in subscriber:
        print(sample.key_expr, len(sample.payload.to_bytes()), "bytes", flush=True)
