"""One aircraft on the bus: its state as messages, its commands, its MAVLink at ticks."""
