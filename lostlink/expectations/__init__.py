"""Whether a recorded run shows what its scenario expects."""
