"""What a run leaves so that it can be flown again and compared: streams, inputs, reports, provenance."""
