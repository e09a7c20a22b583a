"""A record published on Zenoh by wall time."""
