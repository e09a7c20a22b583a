"""What is looked at before a run starts: autopilots, ports, slots."""
