"""PX4's simulator interface: MAVLink messages over TCP, in which PX4 is the client."""
