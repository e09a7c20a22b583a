"""The MAVLink side: commands, missions, parameters, streams and telemetry of one vehicle."""
