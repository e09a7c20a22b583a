"""A run read back: tables, streams and counts of a run directory, for programs of one's own."""
