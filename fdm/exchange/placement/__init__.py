"""On which cores an exchange and its autopilots run."""
