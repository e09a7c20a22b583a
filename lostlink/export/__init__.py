"""The record of a run for other programs: MCAP, CSV."""
