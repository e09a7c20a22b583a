"""Where the autopilot of a UA comes from: real ArduPilot, our stand-in, or something that runs already.

Nothing but this package knows which it is: what it starts, or finds, speaks JSON over UDP to the flight dynamics
and MAVLink over TCP to APS.
"""
