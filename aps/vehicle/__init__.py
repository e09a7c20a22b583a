"""The vehicle: its state, its streams, and commands to it."""
