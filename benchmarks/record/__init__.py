"""Benchmarks of what a run leaves, and of what reads it."""
