"""The flight dynamics exchange: JSBSim airframes in lockstep with ArduPilot's SITL over UDP.

    servo_packet, sensor_frame     the two datagrams of ArduPilot's JSON scheme (codec beside record)
    lockstep                       which frame a servo packet asks for; duplicates, gaps, restarts
    fleet_clock                    how far each UA may step: window, ticks, pace, stall release
    geodesy                        NED as ArduPilot measures it
    airframe                       airframes as data (YAML)
    jsbsim_model                   the only module that imports JSBSim
    truth                          true state of one UA
    hosted_aircraft                one UA: lockstep + model + frame timing, no socket
    exchange                       the sockets and the loop

Imports none of the other packages; ``python -m fdm --help`` tells how to fly an ArduPilot started by hand.
"""
