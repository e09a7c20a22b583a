"""Benchmarks: ratios against a limit or a peer, measured in one run. `make bench` runs them all."""
