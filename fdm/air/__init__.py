"""The air that UA fly in: weather, wind, turbulence, maps."""
