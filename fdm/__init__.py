"""The flight dynamics exchange: JSBSim airframes in lockstep with ArduPilot's SITL over UDP.

    wire/        the two datagrams of ArduPilot's JSON scheme, the legacy scheme, and which frame a packet asks for
    model/       an airframe in JSBSim: data, ground contact, sensors, true state, NED as ArduPilot measures it
    air/         what it flies in: weather, wind, turbulence, wind maps
    clock/       how far each UA may step: window, ticks, pace, stall release
    exchange/    one UA between its datagrams and its model; the sockets and the loop
    workers/     the same over several processes

Only ``model.jsbsim_model`` imports JSBSim. Imports none of the other packages; ``python -m fdm --help`` says how to
fly an ArduPilot started by hand.
"""
