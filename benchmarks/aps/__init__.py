"""Benchmarks of the MAVLink daemon."""
