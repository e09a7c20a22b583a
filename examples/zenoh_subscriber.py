"""Print what the radio delivers in the run that listens at 127.0.0.1:7447. Ctrl-C ends it."""

import time

import zenoh

config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", '["tcp/127.0.0.1:7447"]')
with zenoh.open(config) as session:
    session.declare_subscriber(
        "lostlink/*/ua/*/rx/**", lambda s: print(s.key_expr, len(s.payload.to_bytes()), "bytes", flush=True)
    )
    while True:
        time.sleep(1)
