"""Benchmarks of the flight dynamics."""
