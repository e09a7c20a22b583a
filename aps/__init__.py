"""MAVLink daemon of one UA: state, commands and endpoints for many clients."""
