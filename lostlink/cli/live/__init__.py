"""Commands beside a running simulation or a vehicle."""
