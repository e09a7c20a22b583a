"""Missions, fences and rally points: items, files, and the MAVLink mission protocol."""
