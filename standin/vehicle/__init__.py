"""The vehicle: what it knows, its modes and missions. It knows no MAVLink."""
