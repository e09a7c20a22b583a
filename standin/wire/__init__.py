"""Bytes and values: what goes to and comes from the physics and the MAVLink client."""
