"""Joins autopilots, flight dynamics and radio over Zenoh. The only package that knows the other three."""
