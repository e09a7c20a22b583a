"""SiK telemetry radios: two that share the time in windows, as their firmware does."""
