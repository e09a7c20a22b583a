"""The stand-in autopilot: a small multirotor autopilot with ArduPilot SITL's two interfaces.

It speaks the JSON external-physics scheme over UDP (servo packets out, sensor frames in) and MAVLink over
TCP, as ``arducopter --model JSON:...`` does, so that a machine without ArduPilot can fly. It is for quick
start and tests: its estimator takes the sensor frame as the truth, and it is not ArduPilot.

    wire            bytes <-> values: sensor frames, servo packets, MAVLink framing
    control         references and control loops, down to the motors
    vehicle         what the vehicle knows, its modes and missions
    protocols       the MAVLink side: commands, missions, parameters, streams, telemetry
    autopilot       the sans-IO core: bytes in, bytes out
    process, cli    the shell: sockets, signals, arguments
"""
