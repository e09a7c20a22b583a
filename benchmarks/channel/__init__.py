"""Benchmarks of the channel and its media, and what they are held against."""
