"""Radio physics and the packet-erasure decision: pure functions of geometry, time and a seed.

Nothing in this package reads a clock or a socket; files are read by `presets` and `calibration` only.
"""
