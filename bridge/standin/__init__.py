"""The stand-in autopilot: a small multirotor autopilot with ArduPilot SITL's two interfaces.

It speaks the JSON external-physics scheme over UDP (servo packets out, sensor frames in) and MAVLink over
TCP, as ``arducopter --model JSON:...`` does, so that a machine without ArduPilot can fly. It is for quick
start and tests: its estimator takes the sensor frame as the truth, and it is not ArduPilot.

    sensors, servo_packet, fdm_link      the physics side: bytes <-> values
    quaternion, profile, position_control, attitude_control, mixer, controller      the control loops
    location, parameters, arming, battery, navigator, flight_modes, vehicle         the vehicle
    mission, mission_protocol, commands, guided_targets, streams, telemetry, ...    the MAVLink side
    autopilot       the sans-IO core: bytes and times in, bytes out
    process, cli    the shell: sockets, signals, arguments
"""
