"""Tests of one's own on flights of whole fleets: the pytest fixture `fleet`, and what a flight says of itself.

The fixture `modem_link` gives a lossy radio link between two programs.
"""
