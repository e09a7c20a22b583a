"""What differs between autopilots: one module each, chosen by MAV_AUTOPILOT of the heartbeat."""
